"""The quality of a fit, and in which skirt it is best."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.garments import Skirt
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, count_bits, count_by_camera
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.types import Floats

_LENGTHS_HEIGHTS = (0.18, 0.21, 0.24, 0.27, 0.30, 0.33, 0.36, 0.39, 0.42)
_FLARES_HEIGHTS = (0.0, 0.025, 0.05, 0.08)
_FIRST_FLARE_HEIGHTS = 0.025
"""With which the lengths are compared."""
_LEAST_GAIN = 0.15
"""Share of the energy that a skirt must explain; loose trousers and long shirts reach less."""


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


def in_best_skirt(actor: Actor, poses: Floats, rig: Rig, seen: TriPlanes) -> Actor:
    """The actor in the skirt that fits silhouettes (F, P, H, W) best in poses (F, D), or without one."""

    @cache
    def energy_px(skirt: Skirt | None) -> float:
        return float(quality_of(build_body(actor.in_skirt(skirt)), poses, rig, seen).energy_px.sum())

    lengths = [Skirt(length=length, flare=_FIRST_FLARE_HEIGHTS) for length in _LENGTHS_HEIGHTS]
    length = min(lengths, key=energy_px).length
    best = min((Skirt(length=length, flare=flare) for flare in _FLARES_HEIGHTS), key=energy_px)
    explains = energy_px(best) < (1.0 - _LEAST_GAIN) * energy_px(None)
    return actor.in_skirt(best if explains else None)
