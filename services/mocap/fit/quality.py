"""The quality of a fit."""

from dataclasses import dataclass

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, count_bits, count_by_camera
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.types import Floats


@dataclass(frozen=True, eq=False)
class FitQuality:
    """How well a body in its poses matches the silhouettes."""

    energy_px: Floats
    """(F,) differing pixels of each frame, over all cameras."""
    unexplained_px: Floats
    """(F,) those of them that only the silhouettes have."""
    iou: Floats
    """(F, C) pixels in both silhouettes over pixels in either, unsure ones aside; 1 where both are empty."""


def quality_of(body: Body, poses: Floats, rig: Rig, seen: TriPlanes) -> FitQuality:
    """Compare a body in poses (F, D) with what is seen (F, P, H, W); unsure pixels do not count."""
    backend = CpuBackend(body, rig)
    drawn = backend.coverage(poses, ALL_SURFACES, Region.whole(rig))
    backend.close()
    counted = ~(Region.whole(rig).outside(rig) | seen.unsure)
    both, either = (
        np.array([count_by_camera(planes, rig.n_cameras) for planes in frames], np.float64)
        for frames in (drawn & seen.silhouettes & counted, (drawn | seen.silhouettes) & counted)
    )
    iou = np.where(either > 0, both / np.maximum(either, 1), 1.0)
    unexplained_px = [float(count_bits(planes)) for planes in seen.silhouettes & ~drawn & counted]
    return FitQuality((either - both).sum(axis=1), np.array(unexplained_px), iou)
