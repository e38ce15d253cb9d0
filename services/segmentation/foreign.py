"""Segmenters from other packages, as entry points: what they answer is checked before it is believed."""

from importlib.metadata import entry_points

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.types import Bytes, Mask
from services.segmentation.source import Matte


class ForeignMatte:
    """A matte that another package makes for one camera.

    Its entry point names a class (or function) that is called with the camera and its clean plate (H, W, 3)
    BGR uint8, or None, and returns an object with `silhouette(image_bgr)`: a mask (H, W), true on the actor.
    """

    def __init__(self, name: str, camera: Camera, plate_bgr: Bytes | None, group: str) -> None:
        """Raises UserError where the entry point cannot be loaded or does not come about."""
        self._name, self._shape = name, (camera.height_px, camera.width_px)
        (entry,) = list(entry_points(group=group, name=name))[:1]
        try:
            self._matte: Matte = entry.load()(camera, plate_bgr)
        except UserError:
            raise
        except Exception as problem:
            raise UserError(
                f"--segmenter {name}: {entry.value} failed for {camera.name} "
                f"({type(problem).__name__}: {problem}): ask those who made it"
            ) from problem

    def silhouette(self, image_bgr: Bytes) -> Mask:
        """The actor in an image (H, W, 3): a mask (H, W). Raises UserError for an answer that is none."""
        mask = np.asarray(self._matte.silhouette(image_bgr))
        if mask.dtype != np.bool_ or mask.shape != self._shape:
            raise UserError(
                f"--segmenter {self._name}: expected masks of (height, width) {self._shape} and type bool, "
                f"got {mask.shape} of {mask.dtype}: ask those who made it"
            )
        return np.ascontiguousarray(mask)
