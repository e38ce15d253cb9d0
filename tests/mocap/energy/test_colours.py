"""Colour classes: packed, cut, and painted as a slow painter does it; what is wrong is counted exactly."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.colours import COLOURED, MOST_CLASSES, QUARTERS
from services.mocap.body.garments import Skirt
from services.mocap.body.kinematics import N_DOF, SURFACE_FRAMES, frame_transforms, joint_positions
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import TriPlanes, joined, pack, pack_classes, unpack, unpack_classes
from services.mocap.energy.colours import ColourPainter
from services.mocap.energy.cost import Cost
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SURFACES, LIMBS
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import prepare, whole_body_energy
from services.mocap.take.marks import LimbName
from services.mocap.types import Bytes, Floats

RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]
N = 3
ANY = settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
EVERY_DOF = tuple(range(N_DOF))


@pytest.fixture(scope="module")
def dressed() -> Body:
    """Every quarter of every segment in a random class or none, in a skirt."""
    rng = np.random.default_rng(5)
    colours = {
        name: tuple(rng.integers(0, 1 + MOST_CLASSES, QUARTERS).tolist()) for name in dict.fromkeys(COLOURED)
    }
    return build_body(Actor(colours=colours, skirt=Skirt(length=0.25, flare=0.05)))


def slowly_painted(body: Body, rig: Rig, pose: Floats) -> Bytes:
    """(C, H, W) the classes that cameras see: each surface drawn alone, the farthest first."""
    region, painter = Region.whole(rig), ColourPainter(body, rig)
    backend = CpuBackend(body, rig)
    alone = [unpack(backend.coverage(pose[None], (s,), region)[0], N) for s in ALL_SURFACES]
    T = frame_transforms(pose[None], body.offsets_m)[0]
    rows, columns = np.mgrid[: region.height_px, : region.width_px]
    painted = np.zeros(alone[0].shape, np.uint8)
    for c in range(N):
        P = rig.P_px_world[c]
        eye_m = -np.linalg.solve(P[:, :3], P[:, 3])
        placed = [painter.ends_m[s] @ T[f, :3, :3].T + T[f, :3, 3] for s, f in enumerate(SURFACE_FRAMES)]
        far_m = [
            np.linalg.norm(middle_m - eye_m) - painter.nearer_m[s]
            for s, (_, middle_m, _) in enumerate(placed)
        ]
        for s in np.argsort(far_m)[::-1]:
            (near_u, near_v), (far_u, far_v) = (
                h[:2] / h[2] for h in (P @ np.append(end_m, 1.0) for end_m in placed[s][::2])
            )
            along = np.array([far_u - near_u, far_v - near_v])
            share = ((columns - near_u) * along[0] + (rows - near_v) * along[1]) / max(along @ along, 1e-9)
            quarters = np.clip((QUARTERS * share).astype(int), 0, QUARTERS - 1)
            painted[c][alone[s][c]] = body.colour_classes[s][quarters][alone[s][c]]
    return painted


def some_classes(rig: Rig, seed: int) -> Bytes:
    """(C, H, W) in patches."""
    height, width = rig.shape_px
    patches = np.random.default_rng(seed).integers(0, 1 + MOST_CLASSES, (N, height // 6 + 1, width // 6 + 1))
    return patches.repeat(6, axis=1).repeat(6, axis=2)[:, :height, :width].astype(np.uint8)


def wrong_px(seen: Bytes, painted: Bytes) -> int:
    return int(np.count_nonzero((seen != painted) & (seen != 0) & (painted != 0)))


def picture_with(rig: Rig, classes: Bytes) -> Picture:
    return Picture.of_frame(rig, replace(TriPlanes.sure(pack(classes > 0)), classes=pack_classes(classes)))


@given(seed=st.integers(0, 999), n_cameras=st.integers(1, 17))
def test_classes_survive_packing_and_joining(seed: int, n_cameras: int) -> None:
    classes = np.random.default_rng(seed).integers(0, 8, (n_cameras, 5, 7)).astype(np.uint8)
    planes = pack_classes(classes)
    np.testing.assert_array_equal(unpack_classes(planes, n_cameras), classes)
    whole = replace(TriPlanes.sure(planes[0]), classes=planes)
    order = np.random.default_rng(seed).permutation(n_cameras)
    found = joined([(whole, int(c)) for c in order])
    assert found.classes is not None
    np.testing.assert_array_equal(unpack_classes(found.classes, n_cameras), classes[order])
    none_known = joined([(whole, 0), (TriPlanes.sure(planes[0]), 0)]).classes
    assert none_known is not None
    np.testing.assert_array_equal(unpack_classes(none_known, 2), [classes[0], np.zeros((5, 7))])


@ANY
@given(seed=st.integers(0, 10_000))
def test_a_slow_painter_paints_the_same(
    dressed: Body, ring: Ring, random_poses: RandomPoses, seed: int
) -> None:
    rig, pose = ring(N), random_poses(1, seed)[0]
    found = ColourPainter(dressed, rig).painted(pose, Region.whole(rig))
    different = np.count_nonzero(found != slowly_painted(dressed, rig, pose))
    assert different <= 2, "but for a pixel on the border of two quarters"
    assert np.count_nonzero(found) > 300


@ANY
@given(seed=st.integers(0, 10_000))
def test_wrong_pixels_are_those_of_another_class(
    dressed: Body, ring: Ring, random_poses: RandomPoses, seed: int
) -> None:
    rig, poses = ring(N), random_poses(3, seed)
    classes, painter = some_classes(rig, seed), ColourPainter(dressed, rig)
    picture, region = picture_with(rig, classes), Region.whole(rig)
    expected = np.array([wrong_px(classes, painter.painted(pose, region)) for pose in poses])
    count = painter.wrong_px(Problem(poses[0], EVERY_DOF, ALL_SURFACES, picture))
    np.testing.assert_array_equal(count(poses), expected)
    np.testing.assert_array_equal(count(poses[::-1]), expected[::-1])
    planes = [painter.wrong(picture, pose) for pose in poses]
    np.testing.assert_array_equal([np.bitwise_count(one).sum() for one in planes], expected)
    weighted = Problem(poses[0], EVERY_DOF, ALL_SURFACES, picture, Cost(camera_weights=(0.0, 2.0, 0.0)))
    second = [2.0 * wrong_px(classes[1:2], painter.painted(pose, region)[1:2]) for pose in poses]
    np.testing.assert_array_equal(painter.wrong_px(weighted)(poses), second)


@ANY
@given(seed=st.integers(0, 10_000), limb=st.sampled_from(sorted(LIMBS)))
def test_a_limb_before_the_painted_rest_costs_what_the_whole_body_costs(
    dressed: Body, ring: Ring, random_poses: RandomPoses, seed: int, limb: LimbName
) -> None:
    rig, base = ring(N), random_poses(1, seed)[0]
    stage, picture = LIMBS[limb].main, picture_with(rig, some_classes(rig, seed))
    painter, values = ColourPainter(dressed, rig), random_poses(4, seed + 1)[:, list(stage.dofs)]
    problem = Problem(base, stage.dofs, stage.surfaces, picture)
    whole = painter.wrong_px(replace(problem, dofs=EVERY_DOF, segments=ALL_SURFACES))
    np.testing.assert_array_equal(painter.wrong_px(problem)(values), whole(problem.poses(values)))


def test_an_arm_before_the_trunk_is_told_by_its_colour(ring: Ring, standing_pose: Floats) -> None:
    """Silhouettes do not change where a forearm lies before the trunk; its colour does."""
    sleeves = {
        f"{side}_{name}": (2,) * QUARTERS for side in ("left", "right") for name in ("forearm", "hand")
    }
    body = build_body(Actor(colours={"torso": (1,) * QUARTERS, "pelvis": (1,) * QUARTERS} | sleeves))
    rig = ring(N)
    model = Model(body, rig, CpuBackend(body, rig))
    arm, poses = list(LIMBS["left_arm"].main.dofs), np.tile(standing_pose, (4000, 1))
    # The same arms whatever the joint limits are.
    some_arms = np.radians([[-115, -70, -100, 0], [100, 140, 100, 150]])
    poses[:, arm] = np.random.default_rng(0).uniform(*some_arms, (len(poses), 4))
    poses[0, arm] = [-2.0, -0.03, -0.63, 2.02]  # the hand before the chest
    wrists_m = joint_positions(poses, body.offsets_m)[:, JOINT_INDEX["left_wrist"]]
    is_lost = np.linalg.norm(wrists_m - wrists_m[0], axis=1) > 0.15
    silhouettes = model.backend.coverage(poses[:1], ALL_SURFACES, Region.whole(rig))[0]
    classes = pack_classes(model.colours.painted(poses[0], Region.whole(rig)))
    picture = Picture.of_frame(rig, replace(TriPlanes.sure(silhouettes), classes=classes))
    by_outline, by_colour = (
        whole_body_energy(model, picture, SearchSettings(colour=price, detail_px=0.0))(poses)
        for price in (0.0, 1.0)
    )
    assert by_outline[0] == by_colour[0] == 0.0
    assert by_outline[is_lost].min() < 10
    assert by_colour[is_lost].min() >= 2 * by_outline[is_lost].min() + 8
    limb_energy, _, _ = prepare(
        model, LIMBS["left_arm"].main, picture, poses[0], SearchSettings(windows=False)
    )
    np.testing.assert_array_equal(np.argsort(limb_energy(poses[:, arm]))[0], 0)


def test_windows_cut_classes_as_they_cut_silhouettes(ring: Ring) -> None:
    rig = ring(N)
    classes = some_classes(rig, 3)
    window = picture_with(rig, classes).window(np.array([[10, 5], [-20, 30], [60, -7]], np.int32), 45, 40)
    assert window.classes is not None
    cut = unpack_classes(window.classes, N)
    np.testing.assert_array_equal(cut > 0, unpack(window.silhouettes, N))
    np.testing.assert_array_equal(cut[0], classes[0, 5:45, 10:55])
    assert picture_with(rig, classes).halved().classes is None
