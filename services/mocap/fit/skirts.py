"""Whether the actor wears a skirt or a coat: how much of the silhouettes cloth about the legs explains."""

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skirt import Skirt
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.quality import quality_of
from services.mocap.types import Floats

_LENGTHS_HEIGHTS = (0.18, 0.24, 0.30, 0.36, 0.42)
_FLARES_HEIGHTS = (0.0, 0.025, 0.05, 0.08)
_FIRST_FLARE_HEIGHTS = 0.025
"""With which the lengths are compared."""
_LEAST_GAIN = 0.15
"""Share of the energy that a skirt must explain; loose trousers and long shirts reach less."""


def in_best_skirt(actor: Actor, poses: Floats, rig: Rig, seen: TriPlanes) -> Actor:
    """The actor in the skirt that fits silhouettes (F, P, H, W) best in poses (F, D), or without one."""

    def energy_px(skirt: Skirt | None) -> float:
        return float(quality_of(build_body(actor.wearing(skirt)), poses, rig, seen).energy_px.sum())

    lengths = [Skirt(length=length, flare=_FIRST_FLARE_HEIGHTS) for length in _LENGTHS_HEIGHTS]
    length = min(lengths, key=energy_px).length
    best = min((Skirt(length=length, flare=flare) for flare in _FLARES_HEIGHTS), key=energy_px)
    explains = energy_px(best) < (1.0 - _LEAST_GAIN) * energy_px(None)
    return actor.wearing(best if explains else None)
