"""The quality of a fit."""

from dataclasses import dataclass

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.types import Bytes, Floats


@dataclass(frozen=True, eq=False)
class FitQuality:
    """How well a body in its poses matches the silhouettes."""

    energy_px: Floats
    """(F,) differing pixels of each frame, over all cameras."""
    iou: Floats
    """(F, C) pixels in both silhouettes over pixels in either, unsure ones aside; 1 where both are empty."""

    @property
    def mean_iou(self) -> float:
        """Over all frames and cameras."""
        return float(self.iou.mean())


def quality_of(body: Body, poses: Floats, rig: Rig, seen: TriPlanes) -> FitQuality:
    """Compare a body in poses (F, D) with what is seen (F, P, H, W); unsure pixels do not count."""
    backend = CpuBackend(body, rig)
    drawn = backend.coverage(poses, ALL_SURFACES, Region.whole(rig))
    backend.close()
    counted = ~(Region.whole(rig).outside(rig) | seen.unsure)
    both = np.array([_counts(planes, rig) for planes in drawn & seen.silhouettes & counted])
    either = np.array([_counts(planes, rig) for planes in (drawn | seen.silhouettes) & counted])
    iou = np.where(either > 0, both / np.maximum(either, 1), 1.0)
    return FitQuality((either - both).sum(axis=1).astype(np.float64), iou)


def _counts(planes: Bytes, rig: Rig) -> Floats:
    """(C,) set pixels of each camera."""
    counts: Floats = unpack(planes, rig.n_cameras).sum(axis=(1, 2)).astype(np.float64)
    return counts
