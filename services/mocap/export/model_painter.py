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
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.error_by_part import SEGMENT_PARTS
from services.mocap.take.marks import doubtful_parts
from services.mocap.types import Bytes, Floats, Mask

_SIDE_OF_SURFACE = [segment.side for segment in SEGMENTS] + [None] * len(CLOTH_FRAMES)
_SIDES = tuple(
    (value, tuple(s for s, its_side in enumerate(_SIDE_OF_SURFACE) if its_side == side))
    for value, side in enumerate((None, *SIDES), start=1)
)
"""Values of the centre, the left and the right limbs in pictures, and their surfaces."""


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

    def doubtful(self, pose: Floats, distrusted: Mask) -> list[Mask] | None:
        """Per camera (h, w) where doubtful parts of a pose (D,) are, even behind others; None without one.

        distrusted: (6,) as tracked.
        """
        doubtful = doubtful_parts(distrusted)
        if not doubtful.any():
            return None
        segments = np.flatnonzero(doubtful[SEGMENT_PARTS]).tolist()
        return self.covered(pose, ALL_SURFACES if doubtful.all() else segments)
