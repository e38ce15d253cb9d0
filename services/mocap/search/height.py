"""The actor's height, where nobody gave it, by trying: the one whose body fits the first frame best."""

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu import CpuBackend
from services.mocap.energy.picture import Picture
from services.mocap.search.frame import LocalLimbs, solve_frame
from services.mocap.search.line import minimise_line
from services.mocap.search.settings import SearchSettings
from services.mocap.search.solve import Model
from services.mocap.types import Floats

_STEP = 0.03
"""First change of height that is tried, as a share of it."""
_LARGEST_STEPS = 5.0
_TOLERANCE_STEPS = 0.15
_MOST_TRIES = 5
"""After the best height is bracketed."""


def fit_height(rig: Rig, picture: Picture, pose: Floats, height_m: float) -> float:
    """The height in metres, near height_m, of the generic body that leaves the least energy.

    picture: a whole frame. pose (35,): its pose, found with a body of height_m; that of each other height is
    searched from it for one pass.
    """
    settings = SearchSettings(max_passes=1)

    def energy_px(steps: float) -> float:
        scale = 1.0 + _STEP * steps
        body = build_body(Actor(height=height_m * scale))
        model = Model(body, rig, CpuBackend(body, rig))
        start = pose.copy()
        start[DOF_INDEX["root_z"]] += (scale - 1.0) * body.pelvis_height_m  # the feet stay on the ground
        return solve_frame(model, picture, start[None], settings, LocalLimbs(model)).energy_px

    best = minimise_line(
        energy_px, energy_px(0.0), -_LARGEST_STEPS, _LARGEST_STEPS, _TOLERANCE_STEPS, _MOST_TRIES
    )
    return height_m * (1.0 + _STEP * best.t)
