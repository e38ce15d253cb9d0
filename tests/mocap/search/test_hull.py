"""The visual hull: around the body, as high as the actor, and refused where there is none."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.errors import TakeError
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.hull import Hull, carve, cube_about, look_up
from services.mocap.search.model import Model
from services.mocap.search.plausibility import look_first
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Bytes, Floats, Mask

Poser = Callable[..., Floats]
SilhouettesOf = Callable[[Floats], Bytes]
VOXEL_M = 0.03
# Joints deep in the body; wrists and ankles are about as thin as a voxel.
BULK = ("pelvis", "waist", "neck", "head", "left_hip", "right_hip", "left_shoulder", "right_shoulder")
STANCES = [
    {"root_heading": 20, "shoulder_elevation": -45},
    {"root_heading": -135, "shoulder_elevation": -80},
    {"root_heading": 160, "shoulder_elevation": -85, "hip_abduction": 8},
    {},
]


@pytest.fixture
def masks_of(model: Model, silhouettes_of: SilhouettesOf) -> Callable[[Floats], Mask]:
    return lambda pose: unpack(silhouettes_of(pose), model.rig.n_cameras)


MasksOf = Callable[[Floats], Mask]


@pytest.mark.parametrize("stance", STANCES)
def test_encloses_the_body_and_measures_it(
    model: Model, standing: Poser, masks_of: MasksOf, stance: dict[str, float]
) -> None:
    pose = standing(**stance)
    hull = carve(model.rig, masks_of(pose))
    joints_world_m = joint_positions(pose[None], model.body.offsets_m)[0]
    bulk = joints_world_m[[JOINT_INDEX[name] for name in BULK]]
    tree = cKDTree(hull.points_world_m)
    assert tree.query(bulk)[0].max() <= np.sqrt(3) * VOXEL_M / 2  # within the nearest voxel
    assert tree.query(joints_world_m)[0].max() < 2 * VOXEL_M
    assert hull.height_m == pytest.approx(1.75, abs=0.04)
    assert hull.bottom_m == pytest.approx(0.0, abs=0.03)
    np.testing.assert_allclose(hull.axis_world_m, pose[:2], atol=0.05)


def test_points_are_looked_up_where_they_project(model: Model, masks_of: MasksOf, standing: Poser) -> None:
    rig, mask = model.rig, masks_of(standing())[1]
    points_world_m = cube_about(np.array([0.3, 0.1, 0.9]), 6.0, 0.5)  # some behind the camera, some beside it
    in_picture, on_actor = look_up(rig, mask, 1, points_world_m)
    homogeneous = np.column_stack([points_world_m, np.ones(len(points_world_m))]) @ rig.P_px_world[1].T
    pixel = np.rint(homogeneous[:, :2] / homogeneous[:, 2:])
    width, height = rig.sizes_px[1]
    expected = (homogeneous[:, 2] > 0) & np.all((pixel >= 0) & (pixel < (width, height)), axis=1)
    np.testing.assert_array_equal(in_picture, expected)
    around = ndimage.maximum_filter(mask, 1 + 2 * max(1, round(width / 320)))
    columns, rows = pixel[expected].astype(int).T
    np.testing.assert_array_equal(on_actor[expected], around[rows, columns])
    assert 0 < on_actor.sum() < in_picture.sum() < len(points_world_m)
    assert not on_actor[~expected].any()


def test_is_one_piece_without_doubles(model: Model, standing: Poser, masks_of: MasksOf) -> None:
    hull = carve(model.rig, masks_of(standing(shoulder_elevation=-45)))
    distances_m = cKDTree(hull.points_world_m).query(hull.points_world_m, k=2)[0][:, 1]
    np.testing.assert_allclose(distances_m, VOXEL_M, rtol=1e-6)
    # No looser than its slack: a person of 1.75 m fills about 0.07 cubic metres.
    assert 0.07 < len(hull.points_world_m) * VOXEL_M**3 < 0.15


def test_a_camera_that_sees_nobody_does_not_count(model: Model, standing: Poser, masks_of: MasksOf) -> None:
    masks = masks_of(standing(shoulder_elevation=-45))
    whole = carve(model.rig, masks)
    masks[3] = False
    assert carve(model.rig, masks).height_m == pytest.approx(whole.height_m, abs=0.05)


def test_furniture_in_one_picture_of_nine_cuts_nothing_away(model: Model, standing: Poser) -> None:
    rig, pose = Rig.of(studio_cameras(9)), standing(shoulder_elevation=-45)
    drawn = CpuBackend(model.body, rig).coverage(pose[None], ALL_SURFACES, Region.whole(rig))[0]
    masks = unpack(drawn, 9)
    whole, middle = carve(rig, masks), int(np.nonzero(masks[4].any(axis=0))[0].mean())
    masks[4, :, middle - 6 : middle + 6] = False
    behind_a_post = carve(rig, masks)
    assert behind_a_post.height_m == pytest.approx(whole.height_m, abs=1.1 * VOXEL_M)
    away_m, _ = cKDTree(behind_a_post.points_world_m).query(whole.points_world_m)
    assert np.mean(away_m < 2 * VOXEL_M) > 0.98
    assert look_first(rig, masks).left_out == ()


def test_two_cameras_are_enough(model: Model, standing: Poser, masks_of: MasksOf) -> None:
    pose = standing(shoulder_elevation=-45)
    masks = masks_of(pose)
    masks[[1, 3, 4, 5, 6, 7]] = False  # leaves two that look from about a quarter turn apart
    hull = carve(model.rig, masks)
    np.testing.assert_allclose(hull.axis_world_m, pose[:2], atol=0.1)


@pytest.mark.parametrize("n_seen", [0, 1])
def test_nobody_in_view_is_refused(model: Model, standing: Poser, masks_of: MasksOf, n_seen: int) -> None:
    masks = masks_of(standing())
    masks[n_seen:] = False
    with pytest.raises(
        TakeError, match=rf"^silhouettes: only {n_seen} of 8 cameras show a person"
    ) as refusal:
        carve(model.rig, masks)
    assert "choose a first frame" in str(refusal.value)


@pytest.mark.parametrize("cameras", [[0, 1, 2, 3, 4, 5, 6, 7], [0, 2, 5], [1, 3]])
def test_cameras_that_disagree_are_refused(
    model: Model, standing: Poser, masks_of: MasksOf, cameras: list[int]
) -> None:
    """Every other camera sees someone on the floor, the others the same one a person's height higher."""
    pose = standing(shoulder_elevation=-45)
    raised = pose + 2.1 * np.eye(N_DOF)[2]
    masks = masks_of(pose)
    masks[cameras[::2]] = masks_of(raised)[cameras[::2]]
    rig = Rig(model.rig.P_px_world[cameras], model.rig.sizes_px[cameras])
    with pytest.raises(TakeError, match=r"^calibration\.toml: .* do not meet anywhere in space"):
        carve(rig, masks[cameras])


def test_the_soles_are_where_the_feet_are_wide() -> None:
    def layer(height_m: float, n: int) -> Floats:
        return np.column_stack([VOXEL_M * np.arange(n), np.zeros(n), np.full(n, height_m)])

    tip_then_feet = [layer(-0.06, 2), layer(-0.03, 11), layer(0.0, 30), layer(0.03, 24), layer(0.06, 9)]
    points_m = np.vstack([*tip_then_feet, layer(1.5, 90)])
    hull = Hull(points_m, np.ones(len(points_m), bool))
    assert hull.bottom_m == pytest.approx(0.0)
    assert hull.height_m == pytest.approx(1.5)
