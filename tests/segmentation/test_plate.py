"""The empty stage's statistics and the gauge of exposure, on a made-up wall."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wall_scene import COLOURS, HEIGHT, WIDTH, disc, exposed, plate_frames, wall

from services.mocap.errors import UserError
from services.mocap.types import Bytes, Floats
from services.segmentation.pixels import MEAN_STEPS, WHITENING_STEPS
from services.segmentation.plate import Plate


@pytest.fixture(scope="module")
def plate() -> Plate:
    return Plate.learn(plate_frames(12))


def whitening_of(plate: Plate) -> Floats:
    """(H, W, 3, 3) lower triangles."""
    entries = plate.whitening / float(WHITENING_STEPS)
    zero = np.zeros(plate.shape)
    rows = [[entries[0], zero, zero], [entries[1], entries[2], zero], [entries[3], entries[4], entries[5]]]
    return np.moveaxis(np.array(rows), (0, 1), (2, 3))


def correlated(n: int, covariance: Floats, seed: int) -> list[Bytes]:
    """Pictures of a grey card under noise of a covariance (3, 3)."""
    rng = np.random.default_rng(seed)
    factor = np.linalg.cholesky(covariance)
    noise = rng.normal(0, 1, (n, 30, 40, 3)) @ factor.T
    return list(np.clip(np.rint(noise + np.array([90, 120, 150])), 0, 255).astype(np.uint8))


def test_whitened_noise_has_a_deviation_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.segmentation.plate_noise._NOISE_FLOOR_LEVELS", 0.1)
    monkeypatch.setattr("services.segmentation.exposure.Gauge.gains", lambda *_: np.ones(3, np.float32))
    covariance = np.array([[9.0, 5.0, 2.0], [5.0, 16.0, 6.0], [2.0, 6.0, 12.0]])
    known = Plate.learn(correlated(300, covariance, 0))
    fresh = np.array(correlated(40, covariance, 1)).astype(np.float64)
    off = fresh - np.moveaxis(known.mean, 0, 2) / float(MEAN_STEPS)
    white = np.einsum("hwij,nhwj->nhwi", whitening_of(known), off).reshape(-1, 3)
    np.testing.assert_allclose(np.cov(white.T), np.eye(3), atol=0.05)


def test_the_peak_of_the_density_is_that_of_the_normal_distribution(plate: Plate) -> None:
    whitening = whitening_of(plate)[::17, ::13].reshape(-1, 3, 3)
    expected = [np.log(np.linalg.det(w)) - 1.5 * np.log(2 * np.pi) for w in whitening]
    np.testing.assert_allclose(plate.log_peak[::17, ::13].ravel(), expected, atol=0.01)


@settings(max_examples=10)
@given(st.floats(0.0, 0.1))
def test_uncertain_light_adds_a_share_of_the_brightness_to_the_noise(share: float) -> None:
    card = [np.full((20, 20, 3), 150, np.uint8)]
    exact, doubtful = Plate.learn(card), Plate.learn(card, share)
    blue, doubtful_blue = (float(1 / whitening_of(p)[0, 0, 0, 0]) for p in (exact, doubtful))
    assert doubtful_blue**2 - blue**2 == pytest.approx((150 * share) ** 2, rel=0.01, abs=0.02)


def test_only_outlines_have_slack() -> None:
    picture = np.full((40, 60, 3), 100, np.uint8)
    picture[:, 30:] = 160
    slack = Plate.learn([picture]).slack
    assert slack[:, :28] == pytest.approx(1.0)
    assert slack[:, 32:] == pytest.approx(1.0)
    assert (slack[:, 29:31] < 0.2).all()


def test_a_large_actor_in_one_colour_is_no_white_balance(plate: Plate) -> None:
    scene, actor = wall(), disc(95, (150, 120))
    scene[actor] = COLOURS["blue-grey"]
    gains = plate.gauge.gains(exposed(scene, np.random.default_rng(15)))
    np.testing.assert_allclose(gains, 1, atol=0.03)


def test_an_image_is_evened_to_its_plate(plate: Plate) -> None:
    rng = np.random.default_rng(16)
    evened = plate.gauge.evened(exposed(wall() * (1.1, 1.0, 0.9), rng, 0.9))
    assert evened.dtype == np.uint8
    factors = np.median(evened / wall().clip(1), axis=(0, 1))  # the plate's first frame has a gain of its own
    np.testing.assert_allclose(factors, factors.mean(), rtol=0.005)
    assert factors.mean() == pytest.approx(1, abs=0.03)


def test_a_black_plate_has_no_gauge() -> None:
    black = Plate.learn([np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 3)
    assert black.gauge.places.size == 0
    np.testing.assert_array_equal(black.gauge.gains(plate_frames(1)[0]), 1)


def test_flicker_does_not_pass_for_noise() -> None:
    steady = Plate.learn(plate_frames(20, flicker=0))
    flickering = Plate.learn(plate_frames(20, flicker=0.1))
    # The first entry is one over the blue channel's deviation; noise scales with the first frame's exposure.
    assert np.median(flickering.whitening[0] / steady.whitening[0]) == pytest.approx(1, abs=0.12)
    ratio = flickering.mean / steady.mean
    assert ratio.std() / ratio.mean() < 0.02


def test_movement_in_a_corner_of_the_plate_leaves_the_rest_as_keen() -> None:
    frames = plate_frames(12)
    for i, frame in enumerate(frames):
        frame[:40, 20 * i : 20 * i + 20] = 250
    disturbed = Plate.learn(frames)
    calm = Plate.learn(plate_frames(12))
    assert np.median(disturbed.whitening[0, 60:] / calm.whitening[0, 60:]) == pytest.approx(1, abs=0.05)


def test_frames_may_come_from_a_generator(plate: Plate) -> None:
    streamed = Plate.learn(frame for frame in plate_frames(12))
    np.testing.assert_array_equal(streamed.mean, plate.mean)
    np.testing.assert_array_equal(streamed.whitening, plate.whitening)


def test_frames_of_unlike_sizes_are_refused_in_one_sentence() -> None:
    frames = [np.zeros((240, 320, 3), np.uint8), np.zeros((200, 320, 3), np.uint8)]
    with pytest.raises(UserError, match=r"^clean plate, frame 1: expected 320x240 .* found 320x200: [^.]*$"):
        Plate.learn(frames)


def test_an_empty_plate_is_refused() -> None:
    with pytest.raises(UserError, match=r"^clean plate: no frames: expected one picture or more"):
        Plate.learn([])


def deviation_of(frames: Sequence[Bytes], picture: Bytes | None = None) -> float:
    """The blue channel's, in levels, in the middle of the picture."""
    known = Plate.learn(frames, 0.0, picture)
    return float(1 / whitening_of(known)[HEIGHT // 2, WIDTH // 2, 0, 0])


def test_some_noise_is_expected_of_a_plate_without_any() -> None:
    still = [np.full((HEIGHT, WIDTH, 3), 120, np.uint8)] * 8
    assert deviation_of(still) == pytest.approx(1.5, rel=0.01)


@pytest.mark.parametrize("noise", [5.0, 9.0])
def test_noise_that_a_picture_of_the_take_has_and_the_plate_lacks_is_expected(noise: float) -> None:
    """Also where a quarter of the picture is actor, and the light has changed."""
    frames, rng = plate_frames(12, noise=1.0), np.random.default_rng(6)
    shown = wall()
    shown[disc(80)] = COLOURS["red"]
    usual = deviation_of(frames, picture=exposed(shown, rng, 0.9, 1.0))
    assert usual == deviation_of(frames)
    found = deviation_of(frames, picture=exposed(shown, rng, 0.9, noise))
    assert found == pytest.approx(np.hypot(noise, noise / 3), rel=0.15)


@pytest.mark.parametrize("level", [0, 255])
@pytest.mark.parametrize("share", [0.75, 1.0])
def test_the_actor_before_a_clipped_stage_is_no_noise(level: int, share: float) -> None:
    stage = np.full((HEIGHT, WIDTH, 3), level, np.uint8)
    stage[int(share * HEIGHT) :] = 120
    picture, rng = stage.copy(), np.random.default_rng(4)
    picture[40:200, 120:190] = rng.normal(128, 40, (160, 70, 3)).clip(2, 253)
    assert deviation_of([stage], picture=picture) == pytest.approx(deviation_of([stage]), rel=0.1)


@pytest.mark.parametrize("level", [0, 255])
def test_clipped_pixels_do_not_tell_the_noise(level: int) -> None:
    """Half of the stage is black or overexposed; the exposure differs a little between frames."""
    rng = np.random.default_rng(3)
    frames = []
    for n in range(12):
        scene = np.full((HEIGHT, WIDTH, 3), 120.0)
        scene[: 2 * HEIGHT // 5] = scene[-HEIGHT // 4 :] = -50 if level == 0 else 300
        lit = scene * (1 - 1e-5 * (n % 2)) + rng.normal(0, 2.5, scene.shape)
        frames.append(np.clip(np.rint(lit), 0, 255).astype(np.uint8))
    known = Plate.learn(frames)
    assert np.isfinite(known.log_peak).all()
    assert deviation_of(frames) == pytest.approx(np.hypot(2.5, 1.5), rel=0.4)
