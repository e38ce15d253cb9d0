"""Segmenters from other packages, as entry points: what they answer is checked before it is believed."""

from importlib.metadata import entry_points
from typing import Protocol

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.errors import UserError
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Mask, Trimap


class _Plugin(Protocol):
    """What an entry point of another package returns."""

    def silhouette(self, image_bgr: Bytes, /) -> Mask | Trimap:
        """The actor in a raw picture (H, W, 3) BGR uint8, as (H, W)."""
        ...


class ForeignMatte:
    """A matte that another package makes for one camera.

    Its entry point names a class (or function) that is called with the camera and its clean plate (H, W, 3)
    BGR uint8, or None, and returns an object with `silhouette(image_bgr)`: a mask (H, W) of bool, true on
    the actor, or a trimap (H, W) of uint8: 0 is background, 128 unsure, 255 actor.
    """

    def __init__(self, name: str, camera: Camera, plate_bgr: Bytes | None, group: str) -> None:
        """Raises UserError where the entry point cannot be loaded or made."""
        self._name, self._shape = name, (camera.height_px, camera.width_px)
        (entry,) = list(entry_points(group=group, name=name))[:1]
        try:
            self._plugin: _Plugin = entry.load()(camera, plate_bgr)
        except UserError:
            raise
        except Exception as problem:
            raise UserError(
                f"--segmenter {name}: {entry.value} failed for {camera.name} "
                f"({type(problem).__name__}: {problem}): ask those who made it"
            ) from problem

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """The actor in an image (H, W, 3): a trimap (H, W). Raises UserError for an answer that is none."""
        answer = np.asarray(self._plugin.silhouette(image_bgr))
        if answer.dtype not in (np.bool_, np.uint8) or answer.shape != self._shape:
            raise UserError(
                f"--segmenter {self._name}: expected masks of (height, width) {self._shape} and type bool "
                f"or uint8, got {answer.shape} of {answer.dtype}: ask those who made it"
            )
        if answer.dtype == np.bool_:
            return trimap_of(np.ascontiguousarray(answer, np.bool_))
        return self._checked(np.ascontiguousarray(answer, np.uint8))

    def _checked(self, trimap: Trimap) -> Trimap:
        unknown = ~np.isin(trimap, (BACKGROUND, UNSURE, ACTOR), kind="table")
        if unknown.any():
            raise UserError(
                f"--segmenter {self._name}: expected {BACKGROUND} for background, {UNSURE} for unsure and "
                f"{ACTOR} for the actor in masks of uint8, got {trimap[unknown][0]}: ask those who made it"
            )
        return trimap
