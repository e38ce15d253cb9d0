"""The overlay: the model drawn over what the cameras saw, as a video of all cameras or a picture of one."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
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
from services.mocap.side_by_side import side_by_side
from services.mocap.take.folder import Take
from services.mocap.take.marks import judged_parts
from services.mocap.take.tables import PoseTable
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes, Mask
from services.mocap.verdict.verdict import Verdict, frame_in_words

HEADER_PX, CAUSE_PX = 60, 22
"""Heights of the two lines of text above the tiles, and of a third one where the verdict has a cause."""
_LINES_PX = 27, 50, 72
"""Their base lines."""
_CRF, _OPTIONS = 23, {"preset": "superfast", "threads": "1"}
"""For looking at. With CRF 20 veryfast makes as good pictures in files a seventh smaller, but takes half as
long again."""
_TEXT_SCALE, _SMALL_TEXT_SCALE = 0.6, 0.5
_TILE_WIDTH_PX = 480


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

    The file is H.264 that browsers play, and appears only as a whole. fps: poses per second. verdict: on the
    whole result, written with its first cause over every frame, in which doubtful parts are hatched. hurry:
    called at every frame; if it returns True nothing is written.
    """
    grid = grid_for(take.cameras, _TILE_WIDTH_PX)
    with suppress(_Hurried), ExitStack() as stack:
        sheets = _sheets(take, body, table, grid, verdict, stack)
        size_px = sheet_size_px(grid, verdict)
        video = stack.enter_context(video_writer(path, *size_px, fps, _CRF, _OPTIONS))
        encoder = stack.enter_context(ThreadPoolExecutor(1))
        encoding: Future[None] | None = None
        for sheet in sheets:  # one is drawn while the one before it is encoded
            if hurry():
                raise _Hurried
            if encoding is not None:
                encoding.result()
            encoding = encoder.submit(video.write, sheet)
        if encoding is not None:
            encoding.result()


def _sheets(
    take: Take, body: Body, table: PoseTable, grid: Grid, verdict: Verdict, stack: ExitStack
) -> Iterator[Bytes]:
    """One sheet for each pose. stack: what the videos stay open in."""
    painter, marks, shown = ModelPainter(body, Rig.of(take.cameras)), table.marks, table.frames_shown
    at, stop = int(shown[0]), int(shown[-1]) + 1
    of_cameras = [pictures_of(take, camera, at, stop, stack) for camera in take.cameras]
    for n, frame in enumerate(table.frames.tolist()):
        masks = painter.segment_masks(table.poses[n])
        skipped, at = int(shown[n]) - at, int(shown[n]) + 1
        pictures = side_by_side(next, [islice(pictures, skipped, None) for pictures in of_cameras])
        doubtful, words = None, ""
        if marks is not None and judged_parts(marks.confidence[n], marks.distrusted[n]).any():
            doubtful = painter.doubtful(table.poses[n], marks.distrusted[n])
            words = frame_in_words(marks.distrusted[n].tolist())
        title, energy_px = f"frame {frame}    {table.times_s[n]:.3f} s", float(table.energies_px[n])
        yield draw_sheet(
            take.cameras, grid, verdict, title, energy_px, pictures, masks, doubtful=doubtful, words=words
        )


def pictures_of(take: Take, camera: Camera, start: int, stop: int, stack: ExitStack) -> Iterator[Bytes]:
    """A camera's undistorted pictures (H, W, 3); its silhouettes in greys where it has no video.

    stack: what the video stays open in.
    """
    undistorter = Undistorter(camera)
    if take.has_video(camera):
        return map(undistorter.image, stack.enter_context(take.video(camera, start, stop)))
    return (trimap_picture(undistorter.trimap(trimap)) for trimap in take.trimaps(camera, start, stop))


def sheet_size_px(grid: Grid, verdict: Verdict) -> tuple[int, int]:
    """Width and height of a sheet, both even."""
    header_px = HEADER_PX + (CAUSE_PX if verdict.causes else 0)
    return grid.columns * grid.tile_width_px, grid.rows * grid.tile_height_px + header_px


def draw_sheet(
    cameras: Sequence[Camera],
    grid: Grid,
    verdict: Verdict,
    title: str,
    energy_px: float,
    pictures: Sequence[Bytes],
    segment_masks: Sequence[Bytes],
    *,
    doubtful: Sequence[Mask] | None = None,
    words: str = "",
) -> Bytes:
    """One frame of the overlay, (H, W, 3) in BGR order: a header, and below it the cameras' tiles.

    verdict: on all frames. title: what the header begins with. pictures: per camera, undistorted (H, W, 3).
    segment_masks: per camera (H, W), 0 = no model, 1 = centre, 2 = left limb, 3 = right limb. doubtful: per
    camera (H, W), what is hatched. words: the verdict on this frame; red where something is doubtful, green
    only where no frame is.
    Raises ValueError if the number or the size of pictures or masks is not the cameras'.
    """
    width_px, height_px = sheet_size_px(grid, verdict)
    sheet = np.zeros((height_px, width_px, 3), np.uint8)
    _write_header(sheet, verdict, title, words, energy_px, is_doubtful=doubtful is not None)
    tiles = sheet[-grid.rows * grid.tile_height_px :]

    def draw(of_camera: tuple[int, Camera, Bytes, Bytes, Mask | None]) -> None:
        index, camera, picture, mask, hatch = of_camera
        for given in (mask, picture):
            if given.shape[:2] != camera.shape_px:
                raise ValueError(
                    f"{camera.name}: expected a picture of shape {camera.shape_px}, got {given.shape}"
                )
        tile = draw_tile(picture, mask, grid, hatch)
        write_text(tile, camera.name, (8, 22), WHITE_BGR, _TEXT_SCALE)
        grid.place(tiles, index)[:] = tile

    hatched = [None] * len(cameras) if doubtful is None else doubtful
    side_by_side(draw, list(zip(range(len(cameras)), cameras, pictures, segment_masks, hatched, strict=True)))
    return sheet


def _write_header(
    sheet: Bytes, verdict: Verdict, title: str, words: str, energy_px: float, *, is_doubtful: bool
) -> None:
    """The frame, the verdict on it, its energy, and the colours of the limbs where there is room.

    Below it the verdict on all frames, and its first cause.
    """
    baseline, below, lowest = _LINES_PX
    whole = " - ".join(filter(None, (verdict.headline, verdict.doubts_in_words)))
    write_text(sheet, whole, (10, below), WHITE_BGR, _SMALL_TEXT_SCALE)
    for cause in verdict.causes[:1]:
        write_text(sheet, f"{cause.kind}: {cause}", (10, lowest), WHITE_BGR, _SMALL_TEXT_SCALE)
    good_bgr = CENTRE_BGR if verdict.level == "good" else WHITE_BGR
    end = write_text(sheet, title, (10, baseline), WHITE_BGR, _TEXT_SCALE)
    words_bgr = DOUBTFUL_TEXT_BGR if is_doubtful else good_bgr
    end = write_text(sheet, words, (end + 24, baseline), words_bgr, _TEXT_SCALE)
    differing = f"energy: {energy_px:.0f} px differ"
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
