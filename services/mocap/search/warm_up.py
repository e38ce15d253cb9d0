"""Compiles in advance: `python -m services.mocap.search.warm_up` fills the cache of all processes."""

from dataclasses import replace

import numpy as np

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.colours import QUARTERS
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.compiled import forget_other_code
from services.mocap.energy.bitplanes import CLASS_BITS, TriPlanes, n_planes
from services.mocap.energy.detail.thinning import thinned_levels
from services.mocap.energy.engine import Engine, open_engine
from services.mocap.energy.picture import Picture
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.frame import solve_frame
from services.mocap.search.hull import look_up
from services.mocap.search.jobs import LimbPool, LocalLimbs
from services.mocap.search.model import Model, model_of
from services.mocap.search.settings import SearchSettings

_QUICK = {
    "max_passes": 1,
    "arm_grid": (1, 1, 1, 1),
    "leg_grid": (1, 1, 1, 1),
    "descent_rounds": 1,
    "search_limbs": "always",
}


def warm_up(engine: Engine) -> None:
    """Load or compile everything that solving a frame needs, so that the first task does not wait for it.

    With the cpu backend it also thins the default body with the default settings, and stores it on disk.
    """
    rig = Rig(np.array([[[100.0, 0, 32, 0], [0, 100, 32, 0], [0, 0, 1, 3]]]), np.array([[64, 64]], np.int32))
    actor = Actor(colours={"head": (1,) * QUARTERS})  # a class, so that painting is compiled
    model = model_of(actor, rig, engine)
    rehearse(model, LocalLimbs(model), SearchSettings())
    model.close()


def rehearse(model: Model, limbs: LimbPool, settings: SearchSettings) -> None:
    """Solve a frame without a person, including all limbs, with the least effort.

    Afterwards everything that is loaded, compiled or built at its first use is ready, also in the limb
    workers.
    """
    rig = model.rig
    nothing = np.zeros((n_planes(rig.n_cameras), *rig.shape_px), np.uint8)
    nobody = Picture.of_frame(rig, replace(TriPlanes.sure(nothing), classes=np.stack([nothing] * CLASS_BITS)))
    look_up(rig, np.zeros(rig.shape_px, bool), 0, np.zeros((1, 3)))
    quick = settings.model_copy(update=_QUICK)
    solve_frame(model, nobody, np.zeros((1, N_DOF)), quick, limbs)


if __name__ == "__main__":
    forget_other_code()
    warm_up(open_engine(EngineSettings(backend="cpu")))
    # The thinned default body may be on disk already, made by code of an earlier version.
    surfaces = [(vertices_m, faces) for vertices_m, faces in build_body(Actor()).surfaces if len(faces)]
    thinned_levels(*min(surfaces, key=lambda surface: len(surface[1])))
