import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.synth.studio import STAGE_HEIGHT_M, STAGE_RADIUS_M, studio_cameras


@settings(max_examples=25, deadline=None)
@given(n=st.integers(1, 16), width=st.sampled_from([64, 320, 640]), height=st.sampled_from([64, 240, 480]))
def test_every_camera_sees_the_whole_stage(n: int, width: int, height: int) -> None:
    rng = np.random.default_rng(n)
    angle, radius = rng.uniform(0, 2 * np.pi, 500), STAGE_RADIUS_M * np.sqrt(rng.uniform(0, 1, 500))
    stage_world_m = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0, STAGE_HEIGHT_M, 500)]
    )
    for camera in studio_cameras(n, width, height):
        pixels = camera.project_px(stage_world_m)
        assert pixels.min() >= 0
        assert (pixels <= [width - 1, height - 1]).all()


def test_cameras_stand_around_the_stage() -> None:
    cameras = studio_cameras()
    centres_m = np.array([camera.centre_world_m for camera in cameras])
    distances_m = np.hypot(centres_m[:, 0], centres_m[:, 1])
    assert [camera.name for camera in cameras] == [f"cam{i:02d}" for i in range(1, 9)]
    assert ((distances_m >= 3.8) & (distances_m <= 4.4)).all()
    assert ((centres_m[:, 2] >= 1.2) & (centres_m[:, 2] <= 2.4)).all()
    azimuths = np.unwrap(np.arctan2(centres_m[:, 1], centres_m[:, 0]))
    assert (np.abs(np.diff(azimuths) - np.pi / 4) < 0.3).all()
    assert len({round(float(camera.K[0, 0])) for camera in cameras}) > 4  # focal lengths differ


def test_cameras_are_upright_pinholes() -> None:
    for camera in studio_cameras():
        R = camera.R_camera_world
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert not camera.fisheye and not np.any(camera.distortion)
        low, high = camera.project_px(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.75]]))
        assert low[1] - high[1] > 0.35 * camera.height_px  # head up, and large enough to be of use
        assert low[0] == pytest.approx(high[0], abs=1e-6)


def test_the_studio_is_always_the_same() -> None:
    for one, other in zip(studio_cameras(), studio_cameras(), strict=True):
        np.testing.assert_array_equal(one.P_px_world, other.P_px_world)


@pytest.mark.parametrize("arguments", [(0,), (1, 8, 240), (1, 320, 31)])
def test_refuses_what_no_studio_has(arguments: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="at least 1 camera of 32x32 pixels"):
        studio_cameras(*arguments)
