"""In which hat a fit is best.

A brim hides how large the head is and where it looks, so hats are compared after a short fit of the head
alone. The body's own head is fitted the same way first, and a hat must be clearly better.
"""

from services.mocap.body import shape_space
from services.mocap.body.actor import Actor
from services.mocap.body.garments import Hat
from services.mocap.body.shape_space import INDEX
from services.mocap.body.skeleton import dofs_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.picture import Picture
from services.mocap.fit.contours import contours_of
from services.mocap.fit.least_squares import CONTOUR_POINTS, Fitting
from services.mocap.fit.normal_equations import FitStage, State
from services.mocap.fit.priors import MEAN, Prior
from services.mocap.search.error_by_part import error_by_part
from services.mocap.search.model import model_on_cpu
from services.mocap.types import Floats

_WITH_BRIM = Hat(brim=1.75, peak=1.75, rim=0.03, crown=0.02)
_WITH_PEAK = Hat(brim=1.1, peak=1.7, rim=0.03, crown=0.012)
_LEAST_GAIN = 0.05
"""Share of the head's differing pixels that the best hat must explain. Nine takes of people in hats had 6 to
53 % less in the right one; seven without a hat had more in both of the first two."""
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
    contours, prior = contours_of(rig, seen, CONTOUR_POINTS), Prior(poses)
    x = shape_space.vector_of(actor)
    for name in _HEAD:
        x[INDEX[name]] = MEAN[INDEX[name]]
    usual = shape_space.actor_of(x, actor)

    def head_px(start: Actor) -> int:
        fitting = Fitting(rig, contours, prior, start)
        state = fitting.run(State(shape_space.vector_of(start), poses), _STAGE, lambda: None)
        with model_on_cpu(shape_space.actor_of(state.x, start), rig) as model:
            errors = [
                error_by_part(model, Picture.of_frame(rig, seen[f]), pose)
                for f, pose in enumerate(state.poses)
            ]
        return sum(error.part_px["head"] for error in errors)

    bare_px = head_px(actor.in_hat(None))
    hats = {hat: head_px(usual.in_hat(hat)) for hat in (_WITH_BRIM, _WITH_PEAK)}
    if min(hats.values()) < bare_px:
        for others in (_of_other_height, _on_another_level, _of_other_reach):
            best = min(hats, key=hats.__getitem__)
            hats |= {hat: head_px(usual.in_hat(hat)) for hat in others(best)}
    best = min(hats, key=hats.__getitem__)
    return usual.in_hat(best) if hats[best] < (1.0 - _LEAST_GAIN) * bare_px else actor.in_hat(None)


def _of_other_height(hat: Hat) -> list[Hat]:
    return [hat.model_copy(update={"crown": max(hat.crown + change, 0.0)}) for change in (-0.02, 0.02)]


def _on_another_level(hat: Hat) -> list[Hat]:
    return [hat.model_copy(update={"rim": hat.rim + change}) for change in (-0.015, 0.015)]


def _of_other_reach(hat: Hat) -> list[Hat]:
    reach = {"brim": hat.brim, "peak": hat.peak}
    return [
        hat.model_copy(update={name: 1.0 + times * (of - 1.0) for name, of in reach.items()})
        for times in (0.5, 1.5)
    ]
