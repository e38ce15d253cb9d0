"""Cameras that were knocked after the calibration, found again by the body that they see."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.calibration.from_body import offsets_px, refine_cameras
from services.mocap.camera.camera import Camera, moved_by
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Floats

_ACTOR = Actor(height=1.75)
_KNOCKED = 2


@pytest.fixture(scope="module")
def poses() -> Floats:
    """(12, D) of somebody who walks a circle and swings arms and legs."""
    time = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    poses = np.zeros((len(time), N_DOF))
    poses[:, 0], poses[:, 1] = 0.6 * np.cos(time), 0.6 * np.sin(time)
    poses[:, 2] = build_body(_ACTOR).pelvis_height_m
    poses[:, DOF_INDEX["root_heading"]] = time
    for side, sign in (("left", 1.0), ("right", -1.0)):
        poses[:, DOF_INDEX[f"{side}_shoulder_elevation"]] = np.radians(-45) + 0.4 * sign * np.sin(time)
        poses[:, DOF_INDEX[f"{side}_elbow_flexion"]] = 0.5
        poses[:, DOF_INDEX[f"{side}_hip_flexion"]] = 0.4 * sign * np.sin(2.0 * time)
        poses[:, DOF_INDEX[f"{side}_knee_flexion"]] = 0.3
    return poses


@pytest.fixture(scope="module")
def seen(poses: Floats) -> TriPlanes:
    rig = Rig.of(studio_cameras(6))
    with_body = CpuBackend(build_body(_ACTOR), rig)
    return TriPlanes.sure(with_body.coverage(poses, ALL_SURFACES, Region.whole(rig)))


def _knocked(camera: Camera) -> Camera:
    """By 1 degree and 20 mm."""
    R = Rotation.from_rotvec(np.radians([0.6, -0.8, 0.0])).as_matrix() @ camera.R_camera_world
    centre_m = camera.centre_world_m + np.array([0.012, -0.016, 0.0])
    return replace(camera, R_camera_world=R, t_camera_world_m=-R @ centre_m)


def test_a_knocked_camera_is_found_again_and_the_others_stay(poses: Floats, seen: TriPlanes) -> None:
    true = tuple(studio_cameras(6))
    given = tuple(_knocked(camera) if c == _KNOCKED else camera for c, camera in enumerate(true))
    shares = list[float]()
    refined = refine_cameras(given, seen, _ACTOR, poses, shares.append)
    assert refined.is_better
    assert refined.held.tolist() == [c != _KNOCKED for c in range(6)]
    assert [new == old for new, old in zip(refined.cameras, given, strict=True)] == refined.held.tolist()
    turned_deg, moved_mm = moved_by(refined.cameras[_KNOCKED], true[_KNOCKED])
    assert turned_deg < 0.05
    assert moved_mm < 2
    assert refined.before.iou[:, _KNOCKED].mean() < 0.6
    assert refined.after.iou[:, _KNOCKED].min() > 0.99
    assert shares == sorted(shares)


def test_a_knocked_camera_sees_the_body_beside_the_silhouettes(poses: Floats, seen: TriPlanes) -> None:
    true = tuple(studio_cameras(6))
    given = tuple(_knocked(camera) if c == _KNOCKED else camera for c, camera in enumerate(true))
    offsets = offsets_px(given, seen, _ACTOR, poses)
    assert offsets[_KNOCKED] > 3.0
    assert np.delete(offsets, _KNOCKED).max() < 0.05
    empty = TriPlanes.sure(np.zeros_like(seen.silhouettes))
    assert not offsets_px(true, empty, _ACTOR, poses).any()


def test_cameras_that_stand_where_they_did_are_held(poses: Floats, seen: TriPlanes) -> None:
    cameras = tuple(studio_cameras(6))
    refined = refine_cameras(cameras, seen, _ACTOR, poses)
    assert refined.held.all()
    assert refined.cameras == cameras
    assert not refined.is_better


def test_a_frame_that_shows_nobody_tells_nothing(poses: Floats, seen: TriPlanes) -> None:
    silhouettes = seen.silhouettes.copy()
    silhouettes[4] = 0
    cameras = tuple(studio_cameras(6))
    assert refine_cameras(cameras, TriPlanes.sure(silhouettes), _ACTOR, poses).cameras == cameras
