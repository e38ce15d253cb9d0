"""The overlay video: all cameras on one sheet, with the model drawn over what each of them saw."""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from services.mocap.camera.camera import Camera
from services.mocap.export.tiles import LEFT_BGR, RIGHT_BGR, draw_tile, grid_for, trimap_picture
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes, Trimap

HEADER_PX = 40
"""Height of the line of text above the tiles."""
_CRF = 20  # for looking at
_WHITE_BGR, _BLACK_BGR = (255, 255, 255), (0, 0, 0)


class OverlayWriter:
    """Writes the overlay, one frame for each `add`, as H.264 that browsers play.

    A context manager: the file appears when the block ends well; after an exception nothing is left of it.
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
        images: Sequence[Bytes | None],
        segment_masks: Sequence[Bytes] | Bytes,
        energy: float,
        *,
        trimaps: Sequence[Trimap] | None = None,
    ) -> None:
        """Draw and write one frame.

        images: per camera the undistorted picture (H, W, 3), or None where there is none; there the
        trimap (H, W), if trimaps are given, is drawn in greys in its place, else the ground stays black.
        segment_masks: per camera (H, W), 0 = no model, 1 = centre, 2 = left limb, 3 = right limb; or
        (C, H, W). energy: in pixels. Raises ValueError on a number or size of them that is not the cameras'.
        """
        sheet = np.zeros((*self.size_px[::-1], 3), np.uint8)
        _write_header(sheet, f"frame {frame_index}    {time_s:.3f} s    energy {energy:.0f} px")
        inputs = zip(
            self._cameras,
            images,
            segment_masks,
            [None] * len(self._cameras) if trimaps is None else trimaps,
            strict=True,
        )
        for index, (camera, image, segment_mask, trimap) in enumerate(inputs):
            _check_size(camera, segment_mask)
            tile = draw_tile(_picture(camera, image, trimap), segment_mask, self._grid)
            _write_text(tile, camera.name, (8, 22), _WHITE_BGR)
            x, y = self._grid.tile_origin_px(index)
            below_header = sheet[HEADER_PX:]
            below_header[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
        self._video.write(sheet)


def _picture(camera: Camera, image: Bytes | None, trimap: Trimap | None) -> Bytes:
    """What the model is drawn over, (H, W, 3)."""
    if image is not None:
        _check_size(camera, image)
        return image
    if trimap is not None:
        _check_size(camera, trimap)
        return trimap_picture(trimap)
    return np.zeros((camera.height_px, camera.width_px, 3), np.uint8)


def _check_size(camera: Camera, picture: NDArray[np.generic]) -> None:
    expected = (camera.height_px, camera.width_px)
    if picture.shape[:2] != expected:
        raise ValueError(f"{camera.name}: expected a picture of shape {expected}, got {picture.shape}")


def _write_header(sheet: Bytes, text: str) -> None:
    """The line of text at the left, the colours of the limbs at the right where there is room."""
    baseline = HEADER_PX - 13
    end = _write_text(sheet, text, (10, baseline), _WHITE_BGR)
    x = sheet.shape[1] - 110
    if x > end:
        x = _write_text(sheet, "left", (x, baseline), LEFT_BGR)
        _write_text(sheet, "right", (x + 10, baseline), RIGHT_BGR)


def _write_text(
    picture: Bytes, text: str, origin_px: tuple[int, int], colour_bgr: tuple[int, int, int]
) -> int:
    """Write with a shadow, from the left end of the base line on; returns the x where the text ends."""
    x, y = origin_px
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.6
    cv2.putText(picture, text, (x + 1, y + 1), font, scale, _BLACK_BGR, 1, cv2.LINE_AA)
    cv2.putText(picture, text, origin_px, font, scale, colour_bgr, 1, cv2.LINE_AA)
    (width_px, _), _ = cv2.getTextSize(text, font, scale, 1)
    return x + int(width_px)
