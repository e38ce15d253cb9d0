"""The overlay: the model drawn over what the cameras saw, as a video of all cameras or a picture of one."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.errors import UserError, nearest
from services.mocap.export.model_painter import ModelPainter
from services.mocap.export.text import WHITE_BGR, write_text
from services.mocap.export.tiles import (
    CENTRE_BGR,
    DOUBTFUL_TEXT_BGR,
    LEFT_BGR,
    RIGHT_BGR,
    Grid,
    draw_tile,
    grid_for,
    trimap_picture,
)
from services.mocap.result.result import Result
from services.mocap.side_by_side import N_CORES
from services.mocap.take.folder import Take
from services.mocap.take.marks import judged_parts
from services.mocap.take.tables import PoseTable
from services.mocap.take.writer import VideoWriter, video_writer
from services.mocap.types import Bytes, Mask
from services.mocap.verdict.verdict import Verdict, frame_in_words

HEADER_PX, CAUSE_PX = 60, 22
"""Heights of the two lines of text above the tiles, and of a third one where the verdict has a cause."""
_LINES_PX = 27, 50, 72
"""Their base lines."""
_CRF, _OPTIONS = 23, {"preset": "superfast", "threads": "1"}
"""For looking at. With CRF 20 veryfast makes as good pictures in files a seventh smaller, but takes half as
long again."""
_TEXT_SCALE, _TITLE_SCALE = 0.6, 0.5


class _Hurried(Exception):  # noqa: N818  (a request, not an error)
    """Drawing was interrupted."""


def write_overlay(
    path: Path,
    take: Take,
    body: Body,
    table: PoseTable,
    fps: float,
    verdict: Verdict,
    hurry: Callable[[], bool],
) -> None:
    """Draw poses of frames of a take in their order; a camera without a video shows its silhouettes.

    fps: poses per second. verdict: on the whole result, written with its first cause over every frame, in
    which doubtful parts are hatched. hurry: called at every frame; if it returns True nothing is written.
    """
    shown = table.frames_shown
    painter = ModelPainter(body, Rig.of(take.cameras))
    with suppress(_Hurried), ExitStack() as stack:
        first, stop = int(shown[0]), int(shown[-1]) + 1
        of_cameras = [pictures_of(take, camera, first, stop, stack) for camera in take.cameras]
        writer = stack.enter_context(overlay_writer(path, take.cameras, fps, verdict=verdict))
        marks, at = table.marks, first
        for n, frame in enumerate(table.frames.tolist()):
            if hurry():
                raise _Hurried
            masks = painter.segment_masks(table.poses[n])
            skipped, at = int(shown[n]) - at, int(shown[n]) + 1
            next_ones = [islice(pictures, skipped, None) for pictures in of_cameras]
            pictures = list(writer.pool.map(next, next_ones))
            doubtful, words = None, ""
            if marks is not None and judged_parts(marks.confidence[n], marks.distrusted[n]).any():
                doubtful = painter.doubtful(table.poses[n], marks.distrusted[n])
                words = frame_in_words(marks.distrusted[n].tolist())
            writer.add(
                frame,
                float(table.times_s[n]),
                pictures,
                masks,
                float(table.energies_px[n]),
                doubtful=doubtful,
                words=words,
            )


def pictures_of(take: Take, camera: Camera, start: int, stop: int, stack: ExitStack) -> Iterator[Bytes]:
    """A camera's undistorted pictures (H, W, 3); its silhouettes in greys where it has no video.

    stack: what the video stays open in.
    """
    undistorter = Undistorter(camera)
    if take.has_video(camera):
        return map(undistorter.image, stack.enter_context(take.video(camera, start, stop)))
    return (trimap_picture(undistorter.trimap(trimap)) for trimap in take.trimaps(camera, start, stop))


@contextmanager
def overlay_writer(
    path: Path,
    cameras: Sequence[Camera],
    fps: float,
    *,
    tile_width_px: int = 480,
    verdict: Verdict | None = None,
) -> Iterator["OverlayWriter"]:
    """Write the overlay, one frame for each `add`, as H.264 that browsers play.

    The file appears if the block ends without an exception; otherwise nothing is left. A block that adds no
    frame ends in ValueError. path: of the .mp4. cameras: in the order of what `add` takes. tile_width_px: of
    one camera's tile, made even. verdict: on all frames; it and its first cause stand over every one.
    """
    grid = grid_for(cameras, tile_width_px)
    header_px = HEADER_PX + (CAUSE_PX if verdict is not None and verdict.causes else 0)
    size_px = (grid.columns * grid.tile_width_px, grid.rows * grid.tile_height_px + header_px)  # both even
    with (
        video_writer(path, *size_px, fps, _CRF, _OPTIONS) as video,
        ThreadPoolExecutor(N_CORES) as pool,
        ThreadPoolExecutor(1) as encoder,
    ):
        writer = OverlayWriter(cameras, verdict, grid, header_px, size_px, video, pool, encoder)
        yield writer
        writer.wait()


@dataclass
class OverlayWriter:
    """Draws frames of the overlay and writes them into a video of size_px (width, height)."""

    cameras: Sequence[Camera]
    verdict: Verdict | None
    grid: Grid
    header_px: int
    size_px: tuple[int, int]
    video: VideoWriter
    pool: ThreadPoolExecutor
    """Reads and draws all cameras at the same time."""
    encoder: ThreadPoolExecutor
    """Encodes a frame while the next one is drawn."""
    _being_written: Future[None] | None = None

    def add(
        self,
        frame_index: int,
        time_s: float,
        pictures: Sequence[Bytes],
        segment_masks: Sequence[Bytes] | Bytes,
        energy: float,
        *,
        doubtful: Sequence[Mask] | None = None,
        words: str = "",
    ) -> None:
        """Draw and write one frame.

        pictures: per camera, undistorted (H, W, 3). segment_masks: per camera (H, W), 0 = no model,
        1 = centre, 2 = left limb, 3 = right limb; or (C, H, W). energy: in pixels. doubtful: per camera
        (H, W), what is hatched. words: the verdict on this frame; red where something is doubtful, green only
        where no frame is.
        Raises ValueError if the number or the size of pictures or masks is not the cameras'.
        """
        sheet = np.zeros((*self.size_px[::-1], 3), np.uint8)
        frame = f"frame {frame_index}    {time_s:.3f} s"
        self._write_header(sheet, frame, words, energy, is_doubtful=doubtful is not None)

        def draw(index: int, of_camera: tuple[Camera, Bytes, Bytes, Mask | None]) -> None:
            camera, picture, mask, hatch = of_camera
            for given in (mask, picture):
                if given.shape[:2] != camera.shape_px:
                    raise ValueError(
                        f"{camera.name}: expected a picture of shape {camera.shape_px}, got {given.shape}"
                    )
            tile = draw_tile(picture, mask, self.grid, hatch)
            write_text(tile, camera.name, (8, 22), WHITE_BGR, _TEXT_SCALE)
            self.grid.place(sheet[self.header_px :], index)[:] = tile

        hatched = [None] * len(self.cameras) if doubtful is None else doubtful
        inputs = list(zip(self.cameras, pictures, segment_masks, hatched, strict=True))
        list(self.pool.map(draw, range(len(inputs)), inputs))
        self.wait()
        self._being_written = self.encoder.submit(self.video.write, sheet)

    def wait(self) -> None:
        """Wait until the last frame is encoded; raises what went wrong there."""
        if self._being_written is not None:
            self._being_written.result()

    def _write_header(
        self, sheet: Bytes, frame: str, words: str, energy: float, *, is_doubtful: bool
    ) -> None:
        """The frame, the verdict on it, its energy, and the colours of the limbs where there is room.

        Below it the verdict on all frames, and its first cause.
        """
        baseline, below, lowest = _LINES_PX
        colour_bgr = DOUBTFUL_TEXT_BGR if is_doubtful else WHITE_BGR
        if (verdict := self.verdict) is not None:
            if verdict.level == "good" and not is_doubtful:
                colour_bgr = CENTRE_BGR
            title = " - ".join(filter(None, (verdict.headline, verdict.doubts_in_words)))
            write_text(sheet, title, (10, below), WHITE_BGR, _TITLE_SCALE)
            for cause in verdict.causes[:1]:
                write_text(sheet, f"{cause.kind}: {cause}", (10, lowest), WHITE_BGR, _TITLE_SCALE)
        end = write_text(sheet, frame, (10, baseline), WHITE_BGR, _TEXT_SCALE)
        end = write_text(sheet, words, (end + 24, baseline), colour_bgr, _TEXT_SCALE)
        differing = f"energy: {energy:.0f} px differ"
        end = write_text(sheet, differing, (end + 24, baseline), WHITE_BGR, _TEXT_SCALE)
        x = sheet.shape[1] - 110
        if x > end:
            x = write_text(sheet, "left", (x, baseline), LEFT_BGR, _TEXT_SCALE)
            write_text(sheet, "right", (x + 10, baseline), RIGHT_BGR, _TEXT_SCALE)


def draw_frame(result: Result, take: Take, camera: str, frame: int, *, width_px: int | None = None) -> Bytes:
    """A camera's picture of a frame with the motion's model over it, (H, W, 3) in BGR order.

    camera: its name; frame: its number in the result; width_px: of the drawn picture, by default of those
    that were tracked. Raises UserError if the take has no such camera, or the result no such frame.
    """
    by_name = {one.name: one for one in take.cameras}
    if camera not in by_name:
        raise UserError(f"{camera}: unknown camera: {nearest(camera, by_name)}")
    rows = np.flatnonzero(result.frames == frame)
    if not rows.size:
        raise UserError(f"frame {frame}: expected one from {result.frames[0]} to {result.frames[-1]}")
    seen = by_name[camera]
    with ExitStack() as stack:
        shown = int(result.tracked.frames_shown[rows[0]])
        picture = next(pictures_of(take, seen, shown, shown + 1, stack))
    mask = ModelPainter(result.motion.body, Rig.of((seen,))).segment_masks(result.poses[rows[0]])[0]
    return draw_tile(picture, mask, grid_for([seen], width_px or seen.width_px))
