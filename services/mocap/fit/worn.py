"""In which skirt and which hat a fit is best."""

from functools import cache

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.garments import Skirt
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.hats import in_best_hat
from services.mocap.fit.quality import quality_of
from services.mocap.sampling import evenly
from services.mocap.types import Floats

_MOST_VIEWS, _FEWEST_FRAMES = 40, 3
"""What is worn is told by so many pictures, of all cameras and frames together, but by so many frames at
least. With all pictures, four takes, three of them of people in hats, had the same poses to the last bit."""
_LENGTHS_HEIGHTS = (0.18, 0.21, 0.24, 0.27, 0.30, 0.33, 0.36, 0.39, 0.42)
_FLARES_HEIGHTS = (0.0, 0.025, 0.05, 0.08)
_FIRST_FLARE_HEIGHTS = 0.025
"""With which the lengths are compared."""
_LEAST_GAIN = 0.15
"""Share of the energy that a skirt must explain; loose trousers and long shirts reach less."""


def as_worn(actor: Actor, poses: Floats, rig: Rig, seen: TriPlanes) -> Actor:
    """The actor in the skirt and the hat, or without, that fit silhouettes (F, P, H, W) best in poses (F, D).

    Some of the frames are looked at, evenly spread.
    """
    some = evenly(len(poses), max(_MOST_VIEWS // rig.n_cameras, _FEWEST_FRAMES))
    poses, seen = poses[some], seen[some]
    return in_best_hat(in_best_skirt(actor, poses, rig, seen), poses, rig, seen)


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
