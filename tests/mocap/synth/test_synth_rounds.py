from collections.abc import Callable

import numpy as np
import pytest
from bodies_apart import deepest_overlap_m, nearest_to_trunk

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.kinematics import N_DOF, joint_transforms, segment_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, LOWER, SEGMENT_INDEX, SIDES, UPPER
from services.mocap.synth.choreography import Choreography
from services.mocap.synth.rounds import basic, dance
from services.mocap.synth.studio import studio_cameras
from services.mocap.synth.take import stage_size_m
from services.mocap.synth.walk import STAND_S
from services.mocap.types import Floats

Rounds = Callable[[int, float, Body, int], Floats]
FPS, N = 15.0, 400
TAKES = [(basic, 0), (basic, 1), (dance, 0), (dance, 1), (dance, 2)]


@pytest.fixture(scope="module", params=TAKES, ids=lambda take: f"{take[0].__name__}-{take[1]}")
def take(request: pytest.FixtureRequest, synth_body: Body) -> tuple[str, Floats]:
    rounds, seed = request.param
    return rounds.__name__, rounds(N, FPS, synth_body, seed)


def _joints_m(poses: Floats, body: Body) -> dict[str, Floats]:
    T = joint_transforms(poses, body.offsets_m)
    return {name: T[:, j, :3, 3] for name, j in JOINT_INDEX.items()}


def _vertices_m(poses: Floats, body: Body, *segments: str) -> Floats:
    T = segment_transforms(poses, body.offsets_m)
    rows = [SEGMENT_INDEX[name] for name in segments or SEGMENT_INDEX]
    return np.concatenate(
        [np.einsum("nij,vj->nvi", T[:, s, :3, :3], body.vertices_m[s]) + T[:, s, None, :3, 3] for s in rows],
        axis=1,
    )


def test_within_limits_with_a_margin_and_no_jumps(take: tuple[str, Floats]) -> None:
    name, poses = take
    assert poses.shape == (N, N_DOF)
    assert (np.minimum(poses - LOWER, UPPER - poses) > np.radians(2.0)).all()
    speed = np.abs(np.diff(poses, axis=0)) * FPS
    assert speed[:, 3:].max() < (11.0 if name == "dance" else 7.0)
    assert np.linalg.norm(speed[:, :2], axis=1).max() < 1.8


def test_as_fast_as_people_are(take: tuple[str, Floats], synth_body: Body) -> None:
    name, poses = take
    joints_m = _joints_m(poses, synth_body)
    wrists = np.stack([joints_m[f"{side}_wrist"] for side in SIDES])
    speed_m_s = np.linalg.norm(np.diff(wrists, axis=1), axis=2) * FPS
    low, high = (4.0, 6.0) if name == "dance" else (1.5, 3.0)
    assert low < speed_m_s.max() < high
    assert (0.6 < speed_m_s.mean() < 0.9) if name == "basic" else (1.4 < speed_m_s.mean() < 2.2)


def test_no_part_goes_through_another(take: tuple[str, Floats], synth_body: Body) -> None:
    depth_m, where = deepest_overlap_m(take[1], synth_body)
    assert depth_m < 0.02, where
    assert nearest_to_trunk(take[1], synth_body) > 0.95


def test_feet_on_the_floor_but_for_leaps(take: tuple[str, Floats], synth_body: Body) -> None:
    name, poses = take
    feet_m = _vertices_m(poses, synth_body, "left_foot", "right_foot")
    lowest_m = feet_m[..., 2].min(axis=1)
    assert lowest_m.min() > -0.004
    in_the_air = int((lowest_m > 0.02).sum())
    assert in_the_air == 0 if name == "basic" else 2 <= in_the_air <= 8
    assert np.quantile(np.abs(lowest_m), 0.95) < 0.002


def test_what_stands_does_not_slide(synth_body: Body) -> None:
    fps = 60.0
    for rounds in (basic, dance):
        poses = rounds(1600, fps, synth_body, 0)
        for side in SIDES:
            sole_m = _vertices_m(poses, synth_body, f"{side}_foot")
            down = (sole_m[:-1, :, 2] < 0.0005) & (sole_m[1:, :, 2] < 0.0005)
            slip_m = np.linalg.norm(np.diff(sole_m[..., :2], axis=0), axis=2)
            # The mean over what touches the floor: it may turn on the spot.
            touching = down.any(axis=1)
            mean_m = (slip_m * down).sum(axis=1)[touching] / down.sum(axis=1)[touching]
            assert np.quantile(mean_m, 0.95) < 1e-3
            assert mean_m.max() < 0.03  # brushing the floor into a kick


@pytest.mark.parametrize("height_m", [1.0, 1.9])
@pytest.mark.parametrize("rounds", [basic, dance])
def test_in_every_picture_whatever_the_height(rounds: Rounds, height_m: float) -> None:
    body = build_body(Actor(height=height_m))
    poses = rounds(N, FPS, body, 0)
    vertices_m = _vertices_m(poses[::2], body)[:, ::7]
    assert (np.minimum(poses - LOWER, UPPER - poses) > 0).all()
    radius_m, top_m = stage_size_m(poses, body)
    for camera in studio_cameras(stage_radius_m=radius_m, stage_height_m=top_m):
        pixels = camera.project_px(vertices_m)
        assert pixels.min() > 0
        assert (pixels < [camera.width_px - 1, camera.height_px - 1]).all()


def test_basic_holds_all_its_movements(synth_body: Body) -> None:
    poses = basic(N, FPS, synth_body, 0)
    degrees = np.degrees(poses)
    column = {name: degrees[:, i] for name, i in DOF_INDEX.items()}
    for side in SIDES:
        assert column[f"{side}_shoulder_elevation"].max() > 60
        assert column[f"{side}_shoulder_forward"].max() > 80
        assert column[f"{side}_elbow_flexion"].max() > 115
        assert column[f"{side}_knee_flexion"].max() > 75
    assert column["root_pitch"].max() > 55
    assert np.ptp(column["root_lean"]) > 35
    assert np.ptp(column["head_turn"]) > 90
    assert np.ptp(column["head_pitch"]) > 40
    assert np.ptp(column["root_heading"]) > 355
    assert poses[:, 2].min() < 0.75 * poses[0, 2]


@pytest.mark.parametrize("seed", range(3))
def test_dance_crosses_limbs_kicks_spins_and_leaps(synth_body: Body, seed: int) -> None:
    poses = dance(N, FPS, synth_body, seed)
    joints_m = _joints_m(poses, synth_body)
    left = np.column_stack([-np.sin(poses[:, 3]), np.cos(poses[:, 3])])

    def lefter_m(one: str, other: str) -> Floats:
        return ((joints_m[one] - joints_m[other])[:, :2] * left).sum(axis=1)

    assert (lefter_m("left_wrist", "right_wrist") < -0.1).sum() > 10
    assert (lefter_m("left_ankle", "right_ankle") < -0.02).sum() >= 3
    turned = np.abs(np.diff(poses[:, 3])).sum()
    assert turned > 4 * np.pi
    kicks = [(joints_m[f"{s}_ankle"] - joints_m[f"{s}_hip"])[:, 2].max() for s in SIDES]
    assert max(kicks) > -0.05
    assert np.degrees(poses[:, DOF_INDEX["left_hip_flexion"]]).min() < -10 or (
        np.degrees(poses[:, DOF_INDEX["right_hip_flexion"]]).min() < -10
    )


@pytest.mark.parametrize("rounds", [basic, dance])
def test_begins_in_the_a_pose_and_a_short_take_shows_the_beginning(rounds: Rounds, synth_body: Body) -> None:
    short, long = rounds(40, FPS, synth_body, 3), rounds(450, FPS, synth_body, 3)
    np.testing.assert_allclose(short, long[:40], atol=1e-9)
    still = int(STAND_S * FPS) - 2  # the smoothing of keys begins a little earlier
    np.testing.assert_allclose(short[:still], short[:1].repeat(still, axis=0), atol=1e-6)
    for side in SIDES:
        assert np.degrees(short[0, DOF_INDEX[f"{side}_shoulder_elevation"]]) == pytest.approx(-45)
    assert np.abs(long[400:, 6:]).max() > 0.5  # it goes on
    assert np.abs(rounds(N, FPS, synth_body, 4) - long[:N]).max() > 0.5
    np.testing.assert_array_equal(rounds(40, FPS, synth_body, 3), short)


def test_a_choreography_refuses_what_no_body_does(synth_body: Body) -> None:
    choreography = Choreography(synth_body)
    with pytest.raises(ValueError, match="left_elbow_flexion = 200"):
        choreography.put(0.5, left_elbow_flexion=200.0)
    choreography.step("left", (0.0, 1.0))
    with pytest.raises(ValueError, match="before the last one is done"):
        choreography.step("left", (0.5, 1.5))
    choreography.put(1.0, right_free=1.0)
    with pytest.raises(ValueError, match="right leg in the air"):
        choreography.done(1.0)
