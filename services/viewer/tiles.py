"""The tiles of the camera grid: each camera's picture of a frame, with the model over it, as JPEG."""

import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.export.model_painter import ModelPainter
from services.mocap.export.tiles import (
    Grid,
    differing_pixels,
    draw_classes,
    draw_difference,
    draw_outline,
    trimap_picture,
)
from services.mocap.search.chains import window_origins_px, window_size_px
from services.mocap.search.error_by_part import PART_STAGES
from services.mocap.take.marks import Part
from services.mocap.types import Bytes, Mask
from services.viewer.picture_sources import Pictures, Segmented
from services.viewer.solved_frame import SolvedFrame

Content = Literal["pictures", "silhouettes", "difference", "colours"]
_JPEG = (
    *(cv2.IMWRITE_JPEG_QUALITY, 80),
    # Thin lines keep their colours.
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
)
_KEPT_SHEETS = 8
"""Number of sheets kept for other browsers with the same content."""


@dataclass(frozen=True)
class Look:
    """A user's choice for the grid."""

    content: Content
    cameras: tuple[int, ...]
    part: Part | None
    """Show only this part's window in every camera; None: whole pictures."""
    tile_width_px: int = 320


@dataclass(frozen=True)
class Tile:
    """One camera's."""

    camera: int
    jpeg: bytes
    differing_px: int | None
    """Number of shown pixels in which model and silhouette differ; None without a silhouette."""
    missing: str = ""
    """What of the look is not known, in words; without picture and silhouette the model is drawn on black."""


class TileArtist:
    """Draws tiles of one body in one rig; recent sheets are cached."""

    def __init__(self, body: Body, rig: Rig, pictures: Pictures) -> None:
        self._body, self._rig, self._pictures = body, rig, pictures
        self._painter = ModelPainter(body, rig)
        self._lock = threading.Lock()
        self._drawn = lru_cache(_KEPT_SHEETS)(self._draw)

    def draw(self, solved: SolvedFrame, look: Look) -> tuple[Tile, ...]:
        """The tiles of a look's cameras, in its order."""
        with self._lock:
            return self._drawn(solved, look)

    def catch_up(self, frame: int, look: Look) -> None:
        """Decode the pictures of a look up to a frame."""
        if look.content != "silhouettes":
            with self._lock:
                for camera in look.cameras:
                    self._pictures.picture(camera, frame)

    def background(self, frame: int, camera: int) -> Bytes:
        """A camera's background for a frame (h, w, 3), without the model: its picture, or else its
        silhouette."""
        width, height = self._rig.sizes_px[camera].tolist()
        with self._lock:
            picture = self._pictures.picture(camera, frame)
            segmented = self._pictures.segmented(camera, frame) if picture is None else None
        return _background(picture, segmented, (height, width))

    def _draw(self, solved: SolvedFrame, look: Look) -> tuple[Tile, ...]:
        masks = self._painter.segment_masks(solved.pose)
        doubtful = self._painter.doubtful(solved.pose, solved.distrusted)
        windows = [(slice(None), slice(None))] * self._rig.n_cameras
        if look.part is not None:  # where it is searched
            stage = PART_STAGES[look.part]
            size = window_size_px(stage, self._rig)
            origins_px = window_origins_px((stage,), solved.pose, self._body, self._rig)[0]
            windows = [(slice(y, y + size), slice(x, x + size)) for x, y in origins_px.tolist()]
        return tuple(
            self._tile(solved.frame, c, masks[c], None if doubtful is None else doubtful[c], windows[c], look)
            for c in look.cameras
        )

    def _tile(
        self,
        frame: int,
        camera: int,
        model: Bytes,
        doubtful: Mask | None,
        window: tuple[slice, slice],
        look: Look,
    ) -> Tile:
        picture = None if look.content == "silhouettes" else self._pictures.picture(camera, frame)
        is_needed = picture is None or look.content != "pictures"  # making silhouettes may be expensive
        segmented = self._pictures.segmented(camera, frame) if is_needed else None
        background, model = _background(picture, segmented, model.shape)[window], model[window]
        height = max(2, round(look.tile_width_px * model.shape[0] / model.shape[1]))
        grid = Grid(1, 1, look.tile_width_px, height)
        hatched = None if doubtful is None else doubtful[window]
        seen = None if segmented is None else segmented.trimap[window]
        classes = None if segmented is None or segmented.classes is None else segmented.classes[window]
        if look.content == "difference" and seen is not None:
            drawn = draw_difference(_faded(background), seen, model, grid, hatched)
        elif look.content == "colours" and classes is not None:
            drawn = draw_classes(_faded(background), classes, model, grid)
        else:
            drawn = draw_outline(background, model, grid, hatched)
        differing = None if seen is None else int(np.count_nonzero(differing_pixels(seen, model)))
        jpeg = cv2.imencode(".jpg", drawn, _JPEG)[1]
        missing = ""
        if picture is None and segmented is None:
            missing = "no picture of this frame"
        elif look.content == "colours" and classes is None:
            missing = "no colour classes of this frame"
        return Tile(camera, jpeg.tobytes(), differing, missing)


def _faded(picture: Bytes) -> Bytes:
    """A picture (h, w, 3) in dark greys, so that colours over it tell."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) // 2 + 20
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)


def _background(picture: Bytes | None, segmented: Segmented | None, shape: tuple[int, ...]) -> Bytes:
    """The background of the model, (h, w, 3): black if nothing is known of a frame."""
    if picture is not None:
        return picture
    if segmented is not None:
        return trimap_picture(segmented.trimap)
    return np.zeros((*shape, 3), np.uint8)
