"""What the tests of the fit share: people of random shape before eight cameras, and a guess some way off."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from random_shapes import random_shape
from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.shape_space import body_of
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Floats


@dataclass(frozen=True, eq=False)
class Person:
    """Somebody's true shape and poses, what cameras see of them, and a first guess at the first pose."""

    x: Floats
    body: Body
    poses: Floats
    """(F, D)"""
    seen: TriPlanes
    """(F, P, H, W)"""
    guess: Floats
    """(D,)"""


@pytest.fixture(scope="session")
def rig() -> Rig:
    """Eight cameras of 320x240 pixels."""
    return Rig.of(studio_cameras(8))


@pytest.fixture(scope="session")
def a_person(rig: Rig) -> Callable[[int, int], Person]:
    """`a_person(seed, n_frames)`: a random person in an A pose who begins to walk."""

    def make(seed: int, n_frames: int) -> Person:
        rng = np.random.default_rng(seed)
        x = random_shape(rng, 1.5, 1.9)
        body = body_of(x)
        poses = np.zeros((n_frames, N_DOF))
        poses[:, 2], poses[:, DOF_INDEX["root_heading"]] = body.pelvis_height_m, rng.uniform(-3.0, 3.0)
        for side, sign in (("left", 1.0), ("right", -1.0)):
            poses[:, DOF_INDEX[f"{side}_shoulder_elevation"]] = np.radians(-45)
            poses[:, DOF_INDEX[f"{side}_elbow_flexion"]] = np.radians(12)
            poses[:, DOF_INDEX[f"{side}_hip_abduction"]] = np.radians(9)
            poses[:, DOF_INDEX[f"{side}_hip_flexion"]] = sign * np.radians(4) * np.arange(n_frames)
        silhouettes = CpuBackend(body, rig).coverage(poses, ALL_SURFACES, Region.whole(rig))
        guess = poses[0].copy()
        guess[:3] += rng.normal(size=3) * 0.02
        guess[3:] += rng.normal(size=N_DOF - 3) * np.radians(5)
        return Person(x, body, poses, TriPlanes.sure(silhouettes), clip_to_limits(guess))

    return make
