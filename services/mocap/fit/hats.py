"""In which hat a fit is best.

A brim hides how large the head is and where it looks, so hats are compared after a short fit of the head
alone. The body's own head is fitted the same way first, and a hat must be better by far.
"""

from services.mocap.body import shape_space
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.garments import Hat
from services.mocap.body.shape_space import INDEX
from services.mocap.body.skeleton import dofs_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.contours import contours_of
from services.mocap.fit.least_squares import CONTOUR_POINTS, Fitting
from services.mocap.fit.normal_equations import FitStage, State
from services.mocap.fit.priors import MEAN, WEIGHT_APART_PX3, Prior
from services.mocap.fit.quality import quality_of
from services.mocap.types import Floats

_FIRST = Hat(brim=1.75, rim=0.03, crown=0.02)
_RIMS_HEIGHTS, _CROWNS_HEIGHTS, _BRIMS = (0.015, 0.045), (0.0, 0.04), (1.4, 2.1)
"""What is compared with the first hat, one after the other."""
_LEAST_GAIN = 0.05
"""Share of the energy, of the whole body, that a hat must explain."""
_HEAD = ("head_width", "head_depth")
_FITTED = ("neck", "head", "neck_girth", *_HEAD)
_STAGE = FitStage(
    tuple(INDEX[name] for name in _FITTED), dofs_of("neck", "head"), cap_px=6.0, steps=8, damping=0.003
)


def in_best_hat(actor: Actor, poses: Floats, rig: Rig, seen: TriPlanes) -> Actor:
    """The actor in the hat that fits silhouettes (F, P, H, W) best in poses (F, D), or without one.

    In a hat the head has its mean size again, for a fit to begin with. An own mesh has its own hat.
    """
    if actor.mesh is not None:
        return actor
    contours, prior = contours_of(rig, seen, CONTOUR_POINTS), Prior(poses, WEIGHT_APART_PX3)
    x = shape_space.vector_of(actor)
    for name in _HEAD:
        x[INDEX[name]] = MEAN[INDEX[name]]
    usual = shape_space.actor_of(x, actor)

    def energy_px(start: Actor) -> float:
        fitting = Fitting(rig, contours, prior, start)
        state = fitting.run(State(shape_space.vector_of(start), poses), _STAGE, lambda: None)
        body = build_body(shape_space.actor_of(state.x, start))
        return float(quality_of(body, state.poses, rig, seen).energy_px.sum())

    most_px = (1.0 - _LEAST_GAIN) * energy_px(actor.in_hat(None))
    best, best_px = _FIRST, energy_px(usual.in_hat(_FIRST))
    if best_px > most_px:
        return actor.in_hat(None)
    for field, values in (("crown", _CROWNS_HEIGHTS), ("rim", _RIMS_HEIGHTS), ("brim", _BRIMS)):
        for value in values:
            hat = best.model_copy(update={field: value})
            px = energy_px(usual.in_hat(hat))
            if px < best_px:
                best, best_px = hat, px
    return usual.in_hat(best)
