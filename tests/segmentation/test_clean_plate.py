"""Silhouettes by clean plate, on made-up scenes and on a rendered take."""

from itertools import islice
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from services.mocap.errors import UserError
from services.mocap.types import Bytes, Floats, Mask
from services.segmentation.clean_plate import CleanPlate
from services.segmentation.cleanup import SegmentationSettings

SETTINGS = SegmentationSettings()
TAKE = Path(__file__).resolve().parents[2] / "../shared/data/takes/studio-a"
HEIGHT, WIDTH = 240, 320
COLOURS = {  # BGR; the wall is a warm to cool grey of about 100 to 170
    "red": (30, 25, 160),
    "navy": (95, 45, 35),
    "skin": (110, 140, 195),
    "black": (18, 18, 20),
    "white": (235, 235, 235),
    "blue-grey": (165, 120, 90),
    "light grey": (205, 205, 205),
    "olive": (60, 110, 105),
}


def wall(seed: int = 0) -> Floats:
    """A textured grey wall above a lighter floor, (H, W, 3)."""
    rng = np.random.default_rng(seed)
    coarse = cv2.GaussianBlur(rng.normal(0, 60, (HEIGHT, WIDTH)), (0, 0), 6)
    picture = (
        np.where(np.arange(HEIGHT)[:, None] < 160, 120.0, 150.0) + coarse + rng.normal(0, 3, coarse.shape)
    )
    picture[:, ::40] -= 15  # joints between slabs
    tinted: Floats = picture[..., None] * np.array([1.04, 1.0, 0.96])
    return tinted


def disc(radius_px: int = 40, centre_px: tuple[int, int] = (160, 100)) -> Mask:
    drawn = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(drawn, centre_px, radius_px, 1, thickness=-1)
    return drawn.astype(np.bool_)


def exposed(scene: Floats, rng: np.random.Generator, gain: float = 1.0, noise: float = 2.0) -> Bytes:
    """What a camera makes of a scene: exposure, noise mostly common to the channels, rounding."""
    grain = rng.normal(0, noise, (HEIGHT, WIDTH, 1)) + rng.normal(0, noise / 3, scene.shape)
    return np.clip(np.rint(scene * gain + grain), 0, 255).astype(np.uint8)


def plate_frames(n: int, flicker: float = 0.02, noise: float = 2.0) -> list[Bytes]:
    rng = np.random.default_rng(10)
    return [exposed(wall(), rng, 1 + rng.uniform(-flicker, flicker), noise) for _ in range(n)]


@pytest.fixture(scope="module")
def plate() -> CleanPlate:
    return CleanPlate.learn(plate_frames(12), SETTINGS)


def iou(found: Mask, true: Mask) -> float:
    return float((found & true).sum() / max((found | true).sum(), 1))


def silhouette(plate: CleanPlate, image: Bytes) -> Mask:
    return plate.silhouette(image)


@pytest.mark.parametrize("colour", COLOURS)
def test_actor_stays_and_shadow_goes(plate: CleanPlate, colour: str) -> None:
    rng = np.random.default_rng(1)
    actor, shadow = disc(), disc(45, (215, 170))
    for ratio in (0.5, 0.7, 0.9):
        scene = wall()
        scene[shadow] *= ratio
        scene[actor] = COLOURS[colour]
        found = silhouette(plate, exposed(scene, rng, rng.uniform(0.9, 1.1)))
        assert iou(found, actor) > 0.98
        assert not found[shadow & ~disc(43)].any()


def test_soft_and_tinted_shadow_goes(plate: CleanPlate) -> None:
    depth = cv2.GaussianBlur(disc(45).astype(np.float64), (0, 0), 6)[..., None]
    scene = wall() * (1 - depth * np.array([0.36, 0.40, 0.43]))  # the sky's share is left, a little blue
    assert not silhouette(plate, exposed(scene, np.random.default_rng(2))).any()


def test_what_is_darker_than_any_shadow_is_actor(plate: CleanPlate) -> None:
    scene = wall()
    scene[disc()] *= 0.3
    assert iou(silhouette(plate, exposed(scene, np.random.default_rng(2))), disc()) > 0.98


def test_settings_decide_what_is_shadow() -> None:
    scene = wall()
    scene[disc()] *= 0.6
    image = exposed(scene, np.random.default_rng(2))
    strict = SETTINGS.model_copy(update={"shadow_ratio_min": 0.8})
    assert not silhouette(CleanPlate.learn(plate_frames(8), SETTINGS), image).any()
    assert iou(silhouette(CleanPlate.learn(plate_frames(8), strict), image), disc()) > 0.98


@pytest.mark.parametrize("gain", [0.7, 0.95, 1.0, 1.05, 1.35])
def test_an_empty_scene_has_no_foreground_whatever_the_exposure(plate: CleanPlate, gain: float) -> None:
    image = exposed(wall(), np.random.default_rng(4), gain)
    assert plate.foreground(image).mean() < 2e-4
    assert not silhouette(plate, image).any()


@pytest.mark.parametrize("balance", [(1.12, 1.0, 0.9), (0.85, 0.95, 1.1), (0.75, 0.7, 0.65)])
@pytest.mark.parametrize("colour", ["red", "navy", "skin"])
def test_white_balance_may_drift(plate: CleanPlate, balance: tuple[float, float, float], colour: str) -> None:
    rng = np.random.default_rng(14)
    assert not silhouette(plate, exposed(wall() * balance, rng)).any()
    scene, actor, shadow = wall(), disc(), disc(45, (215, 170))
    scene[shadow] *= 0.6
    scene[actor] = COLOURS[colour]
    found = silhouette(plate, exposed(scene * balance, rng))
    assert iou(found, actor) > 0.98
    assert not found[shadow & ~disc(43)].any()


def test_a_large_actor_in_one_colour_is_no_white_balance(plate: CleanPlate) -> None:
    scene, actor = wall(), disc(95, (150, 120))
    scene[actor] = COLOURS["blue-grey"]
    gains = plate.gauge.gains(exposed(scene, np.random.default_rng(15)), SETTINGS.flicker_limit)
    np.testing.assert_allclose(gains, 1, atol=0.03)


def test_an_image_is_evened_to_its_plate(plate: CleanPlate) -> None:
    rng = np.random.default_rng(16)
    evened = plate.gauge.evened(exposed(wall() * (1.1, 1.0, 0.9), rng, 0.9), SETTINGS.flicker_limit)
    assert evened.dtype == np.uint8
    factors = np.median(evened / wall().clip(1), axis=(0, 1))  # the plate's first frame has a gain of its own
    np.testing.assert_allclose(factors, factors.mean(), rtol=0.005)
    assert factors.mean() == pytest.approx(1, abs=0.03)


def test_exposure_is_judged_by_the_background_even_beside_a_large_actor(plate: CleanPlate) -> None:
    scene, actor = wall(), disc(95, (150, 120))  # more than a third of the picture
    scene[actor] = COLOURS["navy"]
    assert iou(silhouette(plate, exposed(scene, np.random.default_rng(5), 1.08)), actor) > 0.98


def test_a_change_of_light_beyond_flicker_is_not_hidden(plate: CleanPlate) -> None:
    assert plate.foreground(exposed(wall(), np.random.default_rng(6), 1.6)).mean() > 0.9


def test_flicker_does_not_pass_for_noise() -> None:
    steady = CleanPlate.learn(plate_frames(20, flicker=0), SETTINGS)
    flickering = CleanPlate.learn(plate_frames(20, flicker=0.1), SETTINGS)
    # The first entry is one over the blue channel's deviation; noise scales with the first frame's exposure.
    assert np.median(flickering.whitening[0] / steady.whitening[0]) == pytest.approx(1, abs=0.12)
    ratio = flickering.mean / steady.mean
    assert ratio.std() / ratio.mean() < 0.02


def test_more_noise_in_the_plate_means_a_wider_tolerance() -> None:
    noisy = CleanPlate.learn(plate_frames(12, noise=6), SETTINGS)
    image = exposed(wall(), np.random.default_rng(7), noise=6)
    assert not silhouette(noisy, image).any()
    scene = wall()
    scene[disc()] = COLOURS["red"]
    assert iou(silhouette(noisy, exposed(scene, np.random.default_rng(8), noise=6)), disc()) > 0.97


def test_movement_in_a_corner_of_the_plate_leaves_the_rest_as_keen() -> None:
    frames = plate_frames(12)
    for i, frame in enumerate(frames):
        frame[:40, 20 * i : 20 * i + 20] = 250
    disturbed = CleanPlate.learn(frames, SETTINGS)
    calm = CleanPlate.learn(plate_frames(12), SETTINGS)
    assert np.median(disturbed.whitening[0, 60:] / calm.whitening[0, 60:]) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("colour", ["red", "navy", "skin", "black"])
def test_a_single_picture_makes_a_plate(colour: str) -> None:
    single = CleanPlate.learn(plate_frames(1), SETTINGS)
    rng = np.random.default_rng(9)
    assert not silhouette(single, exposed(wall(), rng, 1.05)).any()
    scene = wall()
    scene[disc(45, (215, 170))] *= 0.65
    scene[disc()] = COLOURS[colour]
    assert iou(silhouette(single, exposed(scene, rng)), disc()) > 0.97


def test_thin_limbs_stay_in_one_piece(plate: CleanPlate) -> None:
    limb = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.line(limb, (100, 60), (180, 130), 1, thickness=3)
    scene = wall()
    scene[limb > 0] = COLOURS["skin"]
    found = silhouette(plate, exposed(scene, np.random.default_rng(11)))
    assert iou(found, limb > 0) > 0.97
    assert cv2.connectedComponents(found.view(np.uint8))[0] == 2


def test_a_black_plate_works_without_a_gauge() -> None:
    black = CleanPlate.learn([np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 3, SETTINGS)
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    assert not black.foreground(image).any()
    image[disc()] = 80
    assert iou(silhouette(black, image), disc()) > 0.99


def test_frames_may_come_from_a_generator_and_images_stay_as_they_are(plate: CleanPlate) -> None:
    streamed = CleanPlate.learn((frame for frame in plate_frames(12)), SETTINGS)
    image = exposed(wall(), np.random.default_rng(12))
    before = image.copy()
    assert np.array_equal(streamed.foreground(image), plate.foreground(image))
    assert np.array_equal(image, before)


def test_invalid_sizes_are_refused_in_one_sentence(plate: CleanPlate) -> None:
    with pytest.raises(UserError, match=r"^image: expected 320x240 .* clean plate, found 640x480: [^.]*$"):
        plate.foreground(np.zeros((480, 640, 3), np.uint8))
    with pytest.raises(UserError, match=r"^clean plate, frame 1: expected 320x240 .* found 320x200: [^.]*$"):
        CleanPlate.learn([np.zeros((240, 320, 3), np.uint8), np.zeros((200, 320, 3), np.uint8)], SETTINGS)


def test_an_empty_plate_is_refused() -> None:
    with pytest.raises(UserError, match=r"^clean plate: no frames: expected one picture or more"):
        CleanPlate.learn([], SETTINGS)


@pytest.mark.parametrize("width", [WIDTH - 3, WIDTH - 31, 40])
def test_any_width_will_do(width: int) -> None:
    narrow = CleanPlate.learn([frame[:, :width] for frame in plate_frames(8)], SETTINGS)
    actor = disc(14, (18, 100))
    scene = wall()
    scene[actor] = COLOURS["red"]
    found = narrow.silhouette(exposed(scene, np.random.default_rng(3))[:, :width])
    assert found.shape == (HEIGHT, width)
    assert iou(found, actor[:, :width]) > 0.95


def test_a_silhouette_depends_on_its_own_picture_alone(plate: CleanPlate) -> None:
    rng = np.random.default_rng(13)
    images = []
    for radius in (70, 12, 40, 0):
        scene = wall()
        scene[disc(radius)] = COLOURS["navy"]
        images.append(exposed(scene, rng, rng.uniform(0.9, 1.1)))
    forwards = [silhouette(plate, image) for image in images]
    backwards = [silhouette(plate, image) for image in images[::-1]][::-1]
    assert all(np.array_equal(one, other) for one, other in zip(forwards, backwards, strict=True))


def decode(path: Path, until: int) -> list[Bytes]:
    with av.open(str(path)) as container:
        frames = islice(container.decode(video=0), until)
        return [np.asarray(frame.to_ndarray(format="bgr24"), np.uint8) for frame in frames]


def reference(camera: str, frame: int) -> Mask:
    path = TAKE / f"reference/silhouettes/{camera}/{frame:06d}.png"
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) > 127


@pytest.mark.skipif(not TAKE.is_dir(), reason="the shared takes are not here")
@pytest.mark.parametrize("camera", ["cam01", "cam05", "cam08"])
def test_rendered_studio(camera: str) -> None:
    plate = CleanPlate.learn(decode(TAKE / f"background/{camera}.mp4", 30), SETTINGS)
    images = decode(TAKE / f"videos/{camera}.mp4", 49)
    for frame in (0, 24, 48):
        true, found = reference(camera, frame), silhouette(plate, images[frame])
        assert iou(found, true) > 0.965
        # What is taken wrongly hugs the outline: not a pixel of shadow away from it.
        near = cv2.dilate(true.view(np.uint8), np.ones((7, 7), np.uint8)) > 0
        assert not np.any(found & ~near)
        assert (found & ~true).sum() < 0.025 * true.sum()
        assert (~found & true).sum() < 0.02 * true.sum()
