"""Compiles in advance: `python -m services.mocap.fit.warm_up` fills the cache of all processes."""

import numpy as np

from services.mocap.body import shape_space
from services.mocap.body.actor import Actor
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.picture import Region
from services.mocap.fit.contours import contours_of
from services.mocap.fit.least_squares import Fitting
from services.mocap.fit.normal_equations import ALL_DOFS, FitStage, State
from services.mocap.fit.priors import Prior
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.model import model_on_cpu


def warm_up() -> None:
    """Load or compile what a fit needs: takes one step of the fit to a body that one small camera sees."""
    # Four metres in front of the body, with a focal length and a principal point of 64 pixels.
    P_px_world = np.array([[[64.0, -64, 0, 256], [64, 0, -64, 256], [1, 0, 0, 4]]])
    rig, poses = Rig(P_px_world, np.array([[128, 128]], np.int32)), np.zeros((1, N_DOF))
    with model_on_cpu(Actor(), rig) as model:
        seen = TriPlanes.sure(model.backend.coverage(poses, ALL_SURFACES, Region.whole(rig)))
    seen.unsure[0, 0, 0, 0] = 1  # far from the body, but makes the fit heed unsure pixels
    contours = contours_of(rig, seen, 50)
    state = State(shape_space.vector_of(Actor()), poses)
    Fitting(rig, contours, Prior(poses)).run(state, FitStage((0, 1), ALL_DOFS, 4.0, 1), lambda: None)


if __name__ == "__main__":
    warm_up()
