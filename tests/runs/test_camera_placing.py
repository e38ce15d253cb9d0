"""Cameras are placed where the tracked body shows them, but not if something else spoils what they see."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.camera import Camera, moved_by
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.synth.studio import studio_cameras
from services.mocap.take.folder import Take
from services.mocap.take.moved_cameras import moved_take, moves_in_words, moves_of, take_as_in, write_moved
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Floats
from services.runs.camera_placing import disagree, placed

_ACTOR = Actor(height=1.75)
_CAMERAS = tuple(studio_cameras(5))


@pytest.fixture(scope="module")
def poses() -> Floats:
    """(8, D) of somebody who turns round with an arm and a leg that swing."""
    time = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    poses = np.zeros((len(time), N_DOF))
    poses[:, 2] = build_body(_ACTOR).pelvis_height_m
    poses[:, DOF_INDEX["root_heading"]] = time
    poses[:, DOF_INDEX["left_shoulder_elevation"]] = 0.6 * np.sin(2.0 * time)
    poses[:, DOF_INDEX["right_hip_flexion"]] = 0.5 * np.sin(2.0 * time)
    return poses


@pytest.fixture(scope="module")
def seen(poses: Floats) -> TriPlanes:
    rig = Rig.of(_CAMERAS)
    drawn = CpuBackend(build_body(_ACTOR), rig).coverage(poses, ALL_SURFACES, Region.whole(rig))
    return TriPlanes.sure(drawn)


def _turned(camera: Camera, degrees: float) -> Camera:
    R = Rotation.from_rotvec([0.0, np.radians(degrees), 0.0]).as_matrix() @ camera.R_camera_world
    return replace(camera, R_camera_world=R, t_camera_world_m=-R @ camera.centre_world_m)


def test_a_camera_is_placed_only_where_it_disagrees(poses: Floats, seen: TriPlanes) -> None:
    assert not disagree(_CAMERAS, seen, _ACTOR, poses)
    given = (*_CAMERAS[:4], _turned(_CAMERAS[4], 0.7))
    assert disagree(given, seen, _ACTOR, poses)
    found = placed(given, seen, _ACTOR, poses)
    assert [new is old for new, old in zip(found, given, strict=True)] == [True] * 4 + [False]
    points_m = poses[:, :3]
    np.testing.assert_allclose(found[4].project_px(points_m), _CAMERAS[4].project_px(points_m), atol=0.3)


def test_a_camera_that_sees_something_else_moves_none(poses: Floats, seen: TriPlanes) -> None:
    masks = np.array([unpack(planes, len(_CAMERAS)) for planes in seen.silhouettes])
    half = masks.shape[-1] // 2
    masks[:, 4] = np.roll(masks[:, 4], half // 3, axis=-1) & (np.arange(masks.shape[-1]) % 12 < 6)
    spoilt = TriPlanes.sure(np.array([pack(of_frame) for of_frame in masks]))
    assert disagree(_CAMERAS, spoilt, _ACTOR, poses)
    assert placed(_CAMERAS, spoilt, _ACTOR, poses) is _CAMERAS


def test_two_cameras_both_move_as_nothing_tells_which_one_did(poses: Floats, seen: TriPlanes) -> None:
    two = TriPlanes.sure(
        np.array([pack(unpack(planes, len(_CAMERAS))[[0, 2]]) for planes in seen.silhouettes])
    )
    given = (_CAMERAS[0], _turned(_CAMERAS[2], 1.0))
    found = placed(given, two, _ACTOR, poses)
    moves = [moved_by(old, new) for old, new in zip(given, found, strict=True)]
    assert min(turned_deg for turned_deg, _ in moves) > 0.1


def test_moves_are_told_of_the_cameras_that_moved(tmp_path: Path) -> None:
    settings = TakeSettings(name="take", fps=15, units="m", up="y", frames=8)
    take = Take(Path("take"), settings, _CAMERAS, "silhouettes")
    assert not moves_of(take)
    assert not moves_of(moved_take(take, _CAMERAS))
    moved = moved_take(moved_take(take, [_turned(_CAMERAS[2], 0.2)]), [_turned(_CAMERAS[2], 0.5)])
    ((name, (turned_deg, moved_mm)),) = moves_of(moved).items()
    assert name == _CAMERAS[2].name
    assert turned_deg == pytest.approx(0.5)
    assert moved_mm == pytest.approx(0.0, abs=1e-6)
    assert (
        moves_in_words(moves_of(moved), 5)
        == f"not where calibration.toml says: {name} (by 0.5 degrees, 0 mm)"
    )
    assert name not in moves_in_words(moves_of(moved), 3)

    write_moved(tmp_path, moved)
    again = moves_of(take_as_in(tmp_path, take))
    assert again[name] == pytest.approx((turned_deg, moved_mm), abs=1e-3)
    write_moved(tmp_path, take)
    assert take_as_in(tmp_path, take) is take
