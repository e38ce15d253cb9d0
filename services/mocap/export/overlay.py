"""The overlay: the model drawn over what the cameras saw, as a video of all cameras or a picture of one."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from services.mocap.body.actor import Body
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.errors import UserError, nearest
from services.mocap.export.model_painter import ModelPainter
from services.mocap.export.tiles import LEFT_BGR, RIGHT_BGR, draw_tile, grid_for, trimap_picture, write_text
from services.mocap.result.result import Result
from services.mocap.take.folder import Take
from services.mocap.take.tables import PoseTable
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes

HEADER_PX = 40
"""Height of the line of text above the tiles."""
_CRF = 20  # for looking at
_WHITE_BGR = (255, 255, 255)
_TEXT_SCALE = 0.6


class _Hurried(Exception):  # noqa: N818  (a request, not an error)
    """Drawing was interrupted."""


def write_overlay(path: Path, take: Take, body: Body, table: PoseTable, hurry: Callable[[], bool]) -> None:
    """Draw poses of consecutive frames of a take; a camera without a video shows its silhouettes.

    hurry: called at every frame; if it returns True nothing is written.
    """
    start, stop = int(table.frames[0]), int(table.frames[-1]) + 1
    painter = ModelPainter(body, Rig.of(take.cameras))
    with suppress(_Hurried), ExitStack() as stack:
        of_cameras = [pictures_of(take, camera, start, stop, stack) for camera in take.cameras]
        writer = stack.enter_context(OverlayWriter(path, take.cameras, take.settings.fps))
        for n, frame in enumerate(table.frames.tolist()):
            if hurry():
                raise _Hurried
            masks = painter.segment_masks(table.poses[n])
            pictures = [next(of_camera) for of_camera in of_cameras]
            writer.add(frame, float(table.times_s[n]), pictures, masks, float(table.energies_px[n]))


def pictures_of(take: Take, camera: Camera, start: int, stop: int, stack: ExitStack) -> Iterator[Bytes]:
    """A camera's undistorted pictures (H, W, 3); its silhouettes in greys where it has no video.

    stack: what the video stays open in.
    """
    undistorter = Undistorter(camera)
    if take.has_video(camera):
        return map(undistorter.image, stack.enter_context(take.video(camera, start, stop)))
    return (trimap_picture(undistorter.trimap(trimap)) for trimap in take.trimaps(camera, start, stop))


class OverlayWriter:
    """Writes the overlay, one frame for each `add`, as H.264 that browsers play.

    A context manager: the file appears if the block ends without an exception; otherwise nothing is left.
    A block that adds no frame ends in ValueError. path: of the .mp4. cameras: in the order of what `add`
    takes. tile_width_px: of one camera's tile, made even.
    """

    def __init__(
        self, path: Path, cameras: Sequence[Camera], fps: float, *, tile_width_px: int = 480
    ) -> None:
        self._cameras = tuple(cameras)
        self._grid = grid_for(self._cameras, tile_width_px)
        self._file = video_writer(path, *self.size_px, fps, crf=_CRF)

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height) of the video, both even."""
        grid = self._grid
        return grid.columns * grid.tile_width_px, grid.rows * grid.tile_height_px + HEADER_PX

    def __enter__(self) -> Self:
        self._video = self._file.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.__exit__(kind, error, trace)

    def add(
        self,
        frame_index: int,
        time_s: float,
        pictures: Sequence[Bytes],
        segment_masks: Sequence[Bytes] | Bytes,
        energy: float,
    ) -> None:
        """Draw and write one frame.

        pictures: per camera, undistorted (H, W, 3). segment_masks: per camera (H, W), 0 = no model,
        1 = centre, 2 = left limb, 3 = right limb; or (C, H, W). energy: in pixels. Raises ValueError on a
        number or size of them that is not the cameras'.
        """
        sheet = np.zeros((*self.size_px[::-1], 3), np.uint8)
        _write_header(sheet, f"frame {frame_index}    {time_s:.3f} s    energy {energy:.0f} px")
        inputs = zip(self._cameras, pictures, segment_masks, strict=True)
        for index, (camera, picture, segment_mask) in enumerate(inputs):
            _check_size(camera, segment_mask)
            _check_size(camera, picture)
            tile = draw_tile(picture, segment_mask, self._grid)
            write_text(tile, camera.name, (8, 22), _WHITE_BGR, _TEXT_SCALE)
            self._grid.paste(sheet[HEADER_PX:], index, tile)
        self._video.write(sheet)


def _check_size(camera: Camera, picture: NDArray[np.generic]) -> None:
    expected = (camera.height_px, camera.width_px)
    if picture.shape[:2] != expected:
        raise ValueError(f"{camera.name}: expected a picture of shape {expected}, got {picture.shape}")


def _write_header(sheet: Bytes, text: str) -> None:
    """The line of text at the left, the colours of the limbs at the right where there is room."""
    baseline = HEADER_PX - 13
    end = write_text(sheet, text, (10, baseline), _WHITE_BGR, _TEXT_SCALE)
    x = sheet.shape[1] - 110
    if x > end:
        x = write_text(sheet, "left", (x, baseline), LEFT_BGR, _TEXT_SCALE)
        write_text(sheet, "right", (x + 10, baseline), RIGHT_BGR, _TEXT_SCALE)


def draw_frame(result: Result, take: Take, camera: str, frame: int, *, width_px: int | None = None) -> Bytes:
    """A camera's picture of a frame with the motion's model over it, (H, W, 3) in BGR order.

    camera: its name; frame: its number in the take; width_px: of the drawn picture, the camera's by default.
    Raises UserError if the take has no such camera, or the result no such frame.
    """
    by_name = {one.name: one for one in take.cameras}
    if camera not in by_name:
        raise UserError(f"{camera}: unknown camera: {nearest(camera, by_name)}")
    rows = np.flatnonzero(result.frames == frame)
    if not rows.size:
        raise UserError(f"frame {frame}: expected one from {result.frames[0]} to {result.frames[-1]}")
    seen = by_name[camera]
    with ExitStack() as stack:
        picture = next(pictures_of(take, seen, frame, frame + 1, stack))
    mask = ModelPainter(result.motion.body, Rig.of((seen,))).segment_masks(result.poses[rows[0]])[0]
    return draw_tile(picture, mask, grid_for([seen], width_px or seen.width_px))
