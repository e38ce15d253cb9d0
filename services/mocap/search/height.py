"""Estimates the actor's height if it is not given: the height whose body fits the first frame best."""

from collections.abc import Callable

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import Engine
from services.mocap.energy.picture import Picture
from services.mocap.search.frame import solve_frame
from services.mocap.search.jobs import LimbPool
from services.mocap.search.line import minimise_line
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats

HEIGHT_RANGE_M = (0.7, 2.4)
"""Range of heights, from children to the tallest adults."""
_STEP = 0.03
"""First change of the height, as a share of it."""
_LARGEST_STEPS = 5.0
_TOLERANCE_STEPS = 0.15
_MOST_TRIES = 5
"""Evaluations after the best height is bracketed."""


def fit_height(
    rig: Rig,
    picture: Picture,
    pose: Floats,
    height_m: float,
    pool: Callable[[Model, Actor], LimbPool],
    engine: Engine,
    settings: SearchSettings,
) -> float:
    """The height in metres, near height_m, of the generic body that leaves the least energy.

    picture: a whole frame. pose (D,): its pose, found with a body of height_m, which is in HEIGHT_RANGE_M;
    for each other height one pass searches the pose from there. pool makes the limb pool for a model, engine
    the model's backend; settings: those of the frames to come.
    """
    # No level of detail: thinning a body's meshes takes longer than one search.
    once = settings.model_copy(update={"max_passes": 1, "detail_px": 0.0})

    def energy_px(steps: float) -> float:
        scale = 1.0 + _STEP * steps
        actor = Actor(height=height_m * scale)
        body = build_body(actor)
        model = Model(body, rig, engine.backend(body, rig))
        start = pose.copy()
        start[DOF_INDEX["root_z"]] += (scale - 1.0) * body.pelvis_height_m  # the feet stay on the ground
        limbs = pool(model, actor)
        found = solve_frame(model, picture, start[None], once, limbs)
        model.backend.close()
        return found.energy_px

    low, high = ((limit_m / height_m - 1.0) / _STEP for limit_m in HEIGHT_RANGE_M)
    best = minimise_line(
        energy_px,
        energy_px(0.0),
        max(low, -_LARGEST_STEPS),
        min(high, _LARGEST_STEPS),
        _TOLERANCE_STEPS,
        _MOST_TRIES,
    )
    return height_m * (1.0 + _STEP * best.t)
