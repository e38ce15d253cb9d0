"""Draws the model's silhouettes, by side."""

from collections.abc import Sequence

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import CLOTH_FRAMES
from services.mocap.body.skeleton import SEGMENTS, SIDES
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import camera_bit
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.types import Bytes, Floats, Mask

_SIDE_OF_SURFACE = [segment.side for segment in SEGMENTS] + [None] * len(CLOTH_FRAMES)
_SIDES = tuple(
    (value, tuple(s for s, its_side in enumerate(_SIDE_OF_SURFACE) if its_side == side))
    for value, side in enumerate((None, *SIDES), start=1)
)
"""Names of the centre, the left and the right limbs in pictures, and their surfaces."""


class ModelPainter:
    """Draws which side of the model each pixel shows."""

    def __init__(self, body: Body, rig: Rig) -> None:
        self._backend, self._region, self._sizes_px = CpuBackend(body, rig), Region.whole(rig), rig.sizes_px

    def segment_masks(self, pose: Floats) -> list[Bytes]:
        """Per camera (h, w) of a pose (D,): 0 = no model, 1 = centre, 2 = left limbs, 3 = right limbs."""
        masks: list[Bytes] = [np.zeros((height, width), np.uint8) for width, height in self._sizes_px]
        for value, surfaces in _SIDES:
            for mask, covered in zip(masks, self.covered(pose, surfaces), strict=True):
                mask[covered] = value
        return masks

    def covered(self, pose: Floats, surfaces: Sequence[int]) -> list[Mask]:
        """Per camera (h, w) where some surfaces of a pose (D,) are, even behind others."""
        planes = self._backend.coverage(pose[None], tuple(surfaces), self._region)[0]
        return [camera_bit(planes, c)[:height, :width] for c, (width, height) in enumerate(self._sizes_px)]
