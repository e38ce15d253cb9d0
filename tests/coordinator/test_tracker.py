"""An actor who leaves is missed, not imagined, and is found where they come back."""

import numpy as np
import pytest

from services.coordinator.tracker import Tracker
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import DOF_INDEX, SIDES
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SEGMENTS
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.synth.studio import studio_cameras
from services.mocap.take.marks import PARTS
from services.mocap.types import Bytes, Floats


@pytest.fixture(scope="module")
def model() -> Model:
    body, rig = build_body(Actor(height=1.75)), Rig.of(studio_cameras(6))
    return Model(body, rig, CpuBackend(body, rig))


def _pose(model: Model, x_m: float, heading: float) -> Floats:
    pose = np.zeros(N_DOF)
    pose[:3] = x_m, 0.0, model.body.pelvis_height_m
    pose[DOF_INDEX["root_heading"]] = heading
    for side in SIDES:
        pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = -1.0
    return pose


def _drawn(model: Model, pose: Floats) -> Bytes:
    return model.backend.coverage(pose[None], ALL_SEGMENTS, Region.whole(model.rig))[0]


def test_an_actor_who_leaves_is_missed_and_found_again(model: Model) -> None:
    here, there = _pose(model, 0.0, 0.5), _pose(model, 0.6, -2.0)
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), FrameSolution(here, 0.0))
    seen = tracker.solve(_drawn(model, here))
    assert seen.distrusted == []
    nobody = np.zeros_like(_drawn(model, here))
    for _ in range(3):
        gone = tracker.solve(nobody)
        assert gone.distrusted == list(PARTS)
        np.testing.assert_array_equal(gone.pose, seen.pose)
    back = tracker.solve(_drawn(model, there))
    off_m = np.diff(joint_positions(np.stack([back.pose, there]), model.body.offsets_m), axis=0)
    assert 1000 * np.linalg.norm(off_m, axis=-1).mean() < 30
    assert "torso" not in back.distrusted
    moved = there.copy()
    moved[0] += 0.05
    after = tracker.solve(_drawn(model, moved))
    assert abs(after.pose[0] - moved[0]) < 0.01
