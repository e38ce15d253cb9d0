"""Compiling ahead: `python -m services.mocap.search.warm_up` fills the cache that all processes load from."""

import numpy as np

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.compiled import forget_other_code
from services.mocap.energy.engine import Engine, open_engine
from services.mocap.energy.picture import Picture, Region
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.frame import solve_frame
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings


def warm_up(engine: Engine) -> None:
    """Load or compile all that solving a frame needs, so that the first task does not wait for it.

    By the usual settings: with the cpu backend the default body is thinned, and kept on disk, as well.
    """
    rig = Rig(np.array([[[100.0, 0, 32, 0], [0, 100, 32, 0], [0, 0, 1, 3]]]), np.array([[64, 64]], np.int32))
    body = build_body(Actor())
    picture = Picture.of_region(rig, Region.whole(rig), np.zeros((1, 64, 64), np.uint8))
    quick = SearchSettings(max_passes=1, arm_grid=(1, 1, 1, 1), leg_grid=(1, 1, 1, 1), descent_rounds=1)
    model = Model(body, rig, engine.backend(body, rig))
    solve_frame(model, picture, np.zeros((1, N_DOF)), quick, LocalLimbs(model))
    model.backend.close()


if __name__ == "__main__":
    forget_other_code()
    warm_up(open_engine(EngineSettings(backend="cpu")))
