"""Whether the actor wears a skirt or a coat: how much of the silhouettes a cone about the legs explains."""

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skirt import Skirt
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.quality import quality_of
from services.mocap.types import Floats

_LENGTHS_HEIGHTS = (0.18, 0.24, 0.30, 0.36, 0.42)
_FLARES_HEIGHTS = (0.0, 0.025, 0.05, 0.08)
_FIRST_FLARE_HEIGHTS = 0.025
_LEAST_GAIN = 0.15
"""Share of the energy that a skirt must explain; loose trousers and long shirts reach less."""


def in_best_skirt(actor: Actor, poses: Floats, rig: Rig, seen: TriPlanes) -> Actor:
    """The actor in the skirt that fits silhouettes (F, P, H, W) best in poses (F, D), or without one."""

    def energy_px(skirt: Skirt | None) -> float:
        worn = actor.model_copy(update={"skirt": skirt})
        return float(quality_of(build_body(worn), poses, rig, seen).energy_px.sum())

    lengths = [Skirt(length=length, flare=_FIRST_FLARE_HEIGHTS) for length in _LENGTHS_HEIGHTS]
    longest = min(lengths, key=energy_px)
    flares = [longest.model_copy(update={"flare": flare}) for flare in _FLARES_HEIGHTS]
    best = min(flares, key=energy_px)
    gain = 1.0 - energy_px(best) / max(energy_px(None), 1.0)
    import os

    if os.environ.get("SKIRT_DEBUG"):
        print(
            "skirt",
            [round(energy_px(s)) for s in lengths],
            [round(energy_px(s)) for s in flares],
            round(energy_px(None)),
            best,
            round(gain, 3),
            flush=True,
        )
    return actor.model_copy(update={"skirt": best if gain > _LEAST_GAIN else None})
