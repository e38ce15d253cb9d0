import numpy as np
import pytest

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.kinematics import N_DOF, joint_transforms, segment_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, LOWER, SEGMENT_INDEX, SIDES, UPPER
from services.mocap.synth.studio import studio_cameras
from services.mocap.synth.walk import STAND_S, walk
from services.mocap.types import Floats

TIMINGS = [(30, 15.0), (60, 15.0), (106, 15.0), (300, 15.0), (120, 29.97), (360, 60.0)]


def _vertices_world_m(poses: Floats, body: Body) -> Floats:
    """(N, V, 3) of all segments."""
    T = segment_transforms(poses, body.offsets_m)
    return np.concatenate(
        [
            np.einsum("nij,vj->nvi", T[:, s, :3, :3], vertices_m) + T[:, s, None, :3, 3]
            for s, vertices_m in enumerate(body.vertices_m)
        ],
        axis=1,
    )


@pytest.mark.parametrize(("n_frames", "fps"), TIMINGS)
@pytest.mark.parametrize("height_m", [1.0, 1.75, 1.9])
def test_within_limits_without_jumps(n_frames: int, fps: float, height_m: float) -> None:
    body = build_body(Actor(height=height_m))
    poses = walk(n_frames, fps, body)
    assert poses.shape == (n_frames, N_DOF)
    assert (poses >= LOWER).all()
    assert (poses <= UPPER).all()
    speed = np.abs(np.diff(poses, axis=0)) * fps
    assert speed[:, 3:].max() < 9.0
    assert np.linalg.norm(speed[:, :2], axis=1).max() < 1.3
    assert speed[:, 2].max() < 0.6


@pytest.mark.parametrize(("n_frames", "fps"), [(60, 15.0), (100, 15.0)])
def test_feet_touch_the_floor_and_never_go_under(synth_body: Body, n_frames: int, fps: float) -> None:
    vertices_m = _vertices_world_m(walk(n_frames, fps, synth_body), synth_body)
    np.testing.assert_allclose(vertices_m[..., 2].min(axis=1), 0.0, atol=1e-9)


def test_in_view_of_every_camera_all_the_time(synth_body: Body) -> None:
    vertices_m = _vertices_world_m(walk(60, 15, synth_body), synth_body)
    for camera in studio_cameras():
        pixels = camera.project_px(vertices_m)
        assert pixels.min() > 0
        assert (pixels < [camera.width_px - 1, camera.height_px - 1]).all()


def test_what_is_on_the_floor_does_not_slide(synth_body: Body) -> None:
    poses = walk(480, 60, synth_body)
    T = segment_transforms(poses, synth_body.offsets_m)
    resting = 0
    for side in SIDES:
        s = SEGMENT_INDEX[f"{side}_foot"]
        foot_m = np.einsum("nij,vj->nvi", T[:, s, :3, :3], synth_body.vertices_m[s]) + T[:, s, None, :3, 3]
        on_floor = foot_m[..., 2] < 0.0003
        stays = on_floor[:-1] & on_floor[1:]
        slip_m = np.linalg.norm(np.diff(foot_m[..., :2], axis=0), axis=2)[stays]
        assert np.quantile(slip_m, 0.99) < 1e-4
        assert slip_m.max() < 0.012  # just as a foot lifts; the pelvis goes 17 mm in that 1/60 s
        resting += int(stays.any(axis=1).sum())
    assert resting > 1.1 * len(poses)  # at least one foot, often both


def test_stands_in_an_a_pose_first(synth_body: Body) -> None:
    poses = walk(60, 15, synth_body)
    still = int(STAND_S * 15)
    np.testing.assert_allclose(poses[:still], poses[:1].repeat(still, axis=0), atol=1e-9)
    for side in SIDES:
        assert np.degrees(poses[0, DOF_INDEX[f"{side}_shoulder_elevation"]]) == pytest.approx(-45)


def test_walks_like_a_person(synth_body: Body) -> None:
    fps = 60.0
    poses = walk(600, fps, synth_body)[90:300]  # of 5.2 s of walking, without the first and the last steps
    T = joint_transforms(poses, synth_body.offsets_m)
    speed_m_s = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) * fps
    assert speed_m_s.mean() == pytest.approx(1.0, abs=0.05)
    assert np.hypot(poses[:, 0], poses[:, 1]) == pytest.approx(0.7, abs=0.03)

    def ahead_m(joint: str, of: str) -> Floats:
        way = T[:, JOINT_INDEX[joint], :3, 3] - T[:, JOINT_INDEX[of], :3, 3]
        return way[:, 0] * np.cos(poses[:, 3]) + way[:, 1] * np.sin(poses[:, 3])

    for side, other in (("left", "right"), ("right", "left")):
        leg, arm = ahead_m(f"{side}_ankle", f"{side}_hip"), ahead_m(f"{side}_wrist", f"{side}_shoulder")
        assert np.corrcoef(leg, arm)[0, 1] < -0.7
        assert np.corrcoef(leg, ahead_m(f"{other}_ankle", f"{other}_hip"))[0, 1] < -0.6
        assert leg.max() > 0.15
        assert leg.min() < -0.2
        knee = np.degrees(poses[:, DOF_INDEX[f"{side}_knee_flexion"]])
        assert knee.min() < 25 < 40 < knee.max()


def test_raises_the_arms_then_turns_on_the_spot(synth_body: Body) -> None:
    poses = walk(150, 15, synth_body)
    T = joint_transforms(poses, synth_body.offsets_m)
    for side in SIDES:
        over_head_m = T[:, JOINT_INDEX[f"{side}_wrist"], 2, 3] - T[:, JOINT_INDEX["head_top"], 2, 3]
        assert over_head_m.max() > 0.1
    turning = poses[int(0.82 * 150) :]
    assert np.ptp(turning[:, 3]) > 1.4
    assert np.linalg.norm(np.ptp(turning[:, :2], axis=0)) < 0.06


def test_a_short_take_shows_the_beginning(synth_body: Body) -> None:
    np.testing.assert_array_equal(walk(3, 15, synth_body), walk(30, 15, synth_body)[:3])
