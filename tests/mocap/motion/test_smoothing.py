import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import DOF_INDEX, LOWER, UPPER
from services.mocap.motion.root import ROOT_TURN, root_rotations
from services.mocap.motion.settings import OutputSettings, Smoother
from services.mocap.motion.smoothing import cutoff_of, rts, smoothed
from services.mocap.synth.walk import walk
from services.mocap.take.tables import reference_joints
from services.mocap.types import Floats

FPS = 30.0
SMOOTHERS: list[Smoother] = ["rts", "one-euro"]
WRIST = DOF_INDEX["left_elbow_flexion"]
TIMES_S: Floats = np.arange(240) / FPS


@pytest.fixture(scope="module")
def walking() -> tuple[Floats, Floats]:
    """The poses (N, D) of a walk, and the same with the noise of a tracker, which keeps the limits."""
    poses = walk(150, FPS, build_body(Actor()))
    noise = np.random.default_rng(0).normal(0.0, 0.02, poses.shape)
    return poses, clip_to_limits(poses + noise)


def swinging(frequency_hz: float) -> Floats:
    """Poses (240, D) in which one elbow swings."""
    poses = np.zeros((len(TIMES_S), N_DOF))
    poses[:, WRIST] = 1.0 + 0.5 * np.sin(2 * np.pi * frequency_hz * TIMES_S)
    return poses


def swing_of(poses: Floats) -> float:
    """How far the elbow swings, away from the ends."""
    middle = poses[60:-60, WRIST]
    return float(middle.max() - middle.min()) / 2


@pytest.mark.parametrize("frequency_hz", [0.5, 1.0, 2.0, 4.0, 6.0])
def test_rts_lets_slow_motion_by_and_takes_fast_away(frequency_hz: float) -> None:
    cutoff_hz = 2.0
    gain = swing_of(rts(swinging(frequency_hz), FPS, cutoff_hz)) / 0.5
    assert gain == pytest.approx(1 / (1 + (frequency_hz / cutoff_hz) ** 4), abs=0.03)


def test_rts_shifts_nothing_in_time() -> None:
    poses = swinging(1.0)
    there, back = rts(poses, FPS, 2.0), rts(poses[::-1], FPS, 2.0)[::-1]
    np.testing.assert_allclose(there, back, atol=1e-9)
    moved = [np.correlate(there[60:-60, WRIST] - 1, poses[60 + lag : len(poses) - 60 + lag, WRIST] - 1)[0]
             for lag in range(-5, 6)]  # fmt: skip
    assert np.argmax(moved) == 5


@pytest.mark.parametrize("smooth", SMOOTHERS)
def test_a_noisy_walk_comes_nearer_to_the_truth_and_jitters_less(
    walking: tuple[Floats, Floats], smooth: Smoother
) -> None:
    truth, noisy = walking
    offsets_m = build_body(Actor()).offsets_m
    result = smoothed(noisy, FPS, OutputSettings(smooth=smooth))
    true_m, noisy_m, result_m = (reference_joints(poses, offsets_m) for poses in (truth, noisy, result))
    before, after = (np.linalg.norm(joints - true_m, axis=-1) for joints in (noisy_m, result_m))
    assert after.mean() < (0.75 if smooth == "rts" else 1.0) * before.mean()
    jitter_before, jitter_after = (np.abs(np.diff(j - true_m, 2, axis=0)).mean() for j in (noisy_m, result_m))
    assert jitter_after < 0.5 * jitter_before


@pytest.mark.parametrize("smooth", SMOOTHERS)
@pytest.mark.parametrize("lean", [0.0, 1.5])
def test_a_turning_root_stays_a_rotation(smooth: Smoother, lean: float) -> None:
    """Spinning around three times, and also nearly lying on the side, where heading and pitch are wild."""
    poses = np.zeros((len(TIMES_S), N_DOF))
    poses[:, ROOT_TURN] = np.column_stack([2.3 * TIMES_S, np.full(len(TIMES_S), lean), 0.3 * np.sin(TIMES_S)])
    noise = Rotation.from_rotvec(np.random.default_rng(1).normal(0.0, 0.02, (len(TIMES_S), 3)))
    noisy = poses.copy()
    noisy[:, ROOT_TURN] = np.unwrap((root_rotations(poses) * noise).as_euler("ZXY"), axis=0)
    result = smoothed(noisy, FPS, OutputSettings(smooth=smooth))
    off_rad = (root_rotations(result).inv() * root_rotations(poses)).magnitude()
    assert off_rad.max() < (0.06 if smooth == "rts" else 0.1)
    assert np.abs(np.diff(result[:, ROOT_TURN], axis=0)).max() < (0.3 if lean == 0 else 3.0), "no jumps"


@pytest.mark.parametrize("smooth", SMOOTHERS)
def test_a_heading_that_is_wrapped_is_the_same_motion(smooth: Smoother) -> None:
    poses = np.zeros((len(TIMES_S), N_DOF))
    heading = DOF_INDEX["root_heading"]
    poses[:, heading] = 1.5 * TIMES_S
    wrapped = poses.copy()
    wrapped[:, heading] = (wrapped[:, heading] + np.pi) % (2 * np.pi) - np.pi
    one, other = (smoothed(p, FPS, OutputSettings(smooth=smooth)) for p in (poses, wrapped))
    off_rad = (root_rotations(one).inv() * root_rotations(other)).magnitude()
    assert off_rad.max() < 1e-6
    np.testing.assert_array_less(np.abs(other[:, heading] - wrapped[:, heading]), np.pi)


@pytest.mark.parametrize("smooth", SMOOTHERS)
@settings(max_examples=30)
@given(poses=st.integers(1, 12).flatmap(lambda n: arrays(np.float64, (n, N_DOF), elements=st.floats(-7, 7))))
def test_whatever_comes_the_limits_hold_and_nothing_is_lost(smooth: Smoother, poses: Floats) -> None:
    poses = clip_to_limits(poses)
    given = poses.copy()
    result = smoothed(poses, FPS, OutputSettings(smooth=smooth))
    assert result.shape == poses.shape
    assert np.isfinite(result).all()
    assert (result >= LOWER).all()
    assert (result <= UPPER).all()
    np.testing.assert_array_equal(poses, given)


@pytest.mark.parametrize("smooth", ["none", *SMOOTHERS])
@pytest.mark.parametrize("n_frames", [1, 2, 60])
def test_a_body_at_rest_stays_where_it_is(smooth: Smoother, n_frames: int) -> None:
    pose = clip_to_limits(np.linspace(-1.0, 1.0, N_DOF))
    result = smoothed(np.repeat(pose[None], n_frames, axis=0), FPS, OutputSettings(smooth=smooth))
    np.testing.assert_allclose(result, np.repeat(pose[None], n_frames, axis=0), atol=1e-9)


def test_one_euro_knows_nothing_of_what_is_to_come(walking: tuple[Floats, Floats]) -> None:
    _, noisy = walking
    whole, part = (smoothed(p, FPS, OutputSettings(smooth="one-euro")) for p in (noisy, noisy[:40]))
    np.testing.assert_array_equal(whole[:40], part)


@pytest.mark.parametrize("fps", [15.0, 30.0, 60.0])
def test_the_cutoff_follows_the_motion(fps: float) -> None:
    """Of a slow swing noise is taken away, of a fast one its peaks are kept."""
    times_s, rng = np.arange(240) / fps, np.random.default_rng(2)
    cutoffs_hz, offsets_m = [], build_body(Actor()).offsets_m
    for frequency_hz in (0.3, 3.0):
        truth = np.zeros((len(times_s), N_DOF))
        truth[:, DOF_INDEX["left_shoulder_elevation"]] = np.sin(2 * np.pi * frequency_hz * times_s)
        noisy = truth + rng.normal(0.0, 0.01, truth.shape)
        found_hz = cutoff_of(noisy, fps, OutputSettings())
        assert found_hz is not None
        cutoffs_hz.append(found_hz)
        true_m = reference_joints(truth, offsets_m)
        off_m = [
            np.linalg.norm(reference_joints(rts(noisy, fps, hz), offsets_m) - true_m, axis=-1).mean()
            for hz in (found_hz, 4.0, 12.0)
        ]
        assert off_m[0] < 1.1 * min(off_m)
    assert cutoffs_hz[0] < cutoffs_hz[1]


def test_none_leaves_everything_as_it_was_tracked(walking: tuple[Floats, Floats]) -> None:
    np.testing.assert_array_equal(smoothed(walking[1], FPS, OutputSettings(smooth="none")), walking[1])


@pytest.mark.parametrize("fields", [{"cutoff_hz": 0.0}, {"cutoff_hz": np.nan}, {"smooth": "gauss"}])
def test_settings_that_cannot_be_are_refused(fields: dict) -> None:
    with pytest.raises(ValidationError):
        OutputSettings(**fields)
