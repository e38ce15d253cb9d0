"""What any segmenter that knows the empty stage has to do with one camera alone: on made-up scenes, and on a
rendered take."""

from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from wall_scene import COLOURS, HEIGHT, WIDTH, disc, exposed, iou, plate_frames, wall

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.types import ACTOR, Bytes, Mask, Trimap
from services.segmentation.baselines import PaperTest
from services.segmentation.joint import JointMatte
from services.segmentation.plate import LIGHT_UNCERTAINTY, Plate

SHADOW = disc(28, (250, 180))
"""Less than four of the tiles across in which the light is estimated."""
Cut = Callable[[Bytes], Trimap]


def joint(frames: Sequence[Bytes]) -> JointMatte:
    plate = Plate.learn(frames, LIGHT_UNCERTAINTY)
    height, width = plate.shape
    K = np.array([[300.0, 0, (width - 1) / 2], [0, 300.0, (height - 1) / 2], [0, 0, 1]])
    camera = Camera("cam01", width, height, K, np.zeros(4), np.eye(3), np.zeros(3))
    return JointMatte([camera], [plate])


def cutter(name: str, frames: Sequence[Bytes]) -> Cut:
    if name == "paper":
        return PaperTest.learn(frames).trimap
    segmenter = joint(frames)
    return lambda image: segmenter.trimaps({0: image})[0]


@pytest.fixture(scope="module", params=["clean-plate", "paper"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def cut(kind: str) -> Cut:
    return cutter(kind, plate_frames(12))


def silhouette(cut: Cut, image: Bytes) -> Mask:
    return np.asarray(cut(image) == ACTOR)


@pytest.mark.parametrize("colour", COLOURS)
def test_actor_stays_and_shadow_goes(cut: Cut, colour: str) -> None:
    rng = np.random.default_rng(1)
    for ratio in (0.5, 0.7, 0.9):
        scene = wall()
        scene[SHADOW] *= ratio
        scene[disc()] = COLOURS[colour]
        found = silhouette(cut, exposed(scene, rng, rng.uniform(0.9, 1.1)))
        assert iou(found, disc()) > 0.98
        assert not found[SHADOW].any()


def test_soft_shadow_goes(cut: Cut) -> None:
    depth = cv2.GaussianBlur(SHADOW.astype(np.float64), (0, 0), 6)[..., None]
    assert not silhouette(cut, exposed(wall() * (1 - 0.4 * depth), np.random.default_rng(2))).any()


def test_what_is_darker_than_any_shadow_is_actor(cut: Cut) -> None:
    scene = wall()
    scene[disc()] *= 0.3
    assert iou(silhouette(cut, exposed(scene, np.random.default_rng(2))), disc()) > 0.98


@pytest.mark.parametrize("gain", [0.7, 0.95, 1.0, 1.05, 1.35])
def test_an_empty_scene_is_all_background_whatever_the_exposure(cut: Cut, gain: float) -> None:
    assert not cut(exposed(wall(), np.random.default_rng(4), gain)).any()


@pytest.mark.parametrize("balance", [(1.12, 1.0, 0.9), (0.85, 0.95, 1.1), (0.75, 0.7, 0.65)])
@pytest.mark.parametrize("colour", COLOURS)
def test_white_balance_may_drift(cut: Cut, balance: tuple[float, float, float], colour: str) -> None:
    rng = np.random.default_rng(14)
    assert not cut(exposed(wall() * balance, rng)).any()
    scene = wall()
    scene[SHADOW] *= 0.6
    scene[disc()] = COLOURS[colour]
    found = silhouette(cut, exposed(scene * balance, rng))
    assert iou(found, disc()) > 0.98
    assert not found[SHADOW].any()


def test_exposure_is_judged_by_the_background_even_beside_a_large_actor(cut: Cut) -> None:
    scene, actor = wall(), disc(95, (150, 120))  # more than a third of the picture
    scene[actor] = COLOURS["navy"]
    assert iou(silhouette(cut, exposed(scene, np.random.default_rng(5), 1.08)), actor) > 0.98


def test_a_change_of_light_beyond_flicker_is_not_hidden(cut: Cut) -> None:
    assert silhouette(cut, exposed(wall(), np.random.default_rng(6), 1.6)).mean() > 0.9


def test_more_noise_in_the_plate_means_a_wider_tolerance(kind: str) -> None:
    noisy = cutter(kind, plate_frames(12, noise=6))
    assert not noisy(exposed(wall(), np.random.default_rng(7), noise=6)).any()
    scene = wall()
    scene[disc()] = COLOURS["red"]
    assert iou(silhouette(noisy, exposed(scene, np.random.default_rng(8), noise=6)), disc()) > 0.97


@pytest.mark.parametrize("colour", COLOURS)
def test_a_single_picture_makes_a_plate(kind: str, colour: str) -> None:
    single = cutter(kind, plate_frames(1))
    rng = np.random.default_rng(9)
    assert not single(exposed(wall(), rng, 1.05)).any()
    scene = wall()
    scene[SHADOW] *= 0.65
    scene[disc()] = COLOURS[colour]
    assert iou(silhouette(single, exposed(scene, rng)), disc()) > 0.97


def test_thin_limbs_stay_in_one_piece(cut: Cut) -> None:
    limb = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.line(limb, (100, 60), (180, 130), 1, thickness=3)
    scene = wall()
    scene[limb > 0] = COLOURS["skin"]
    found = silhouette(cut, exposed(scene, np.random.default_rng(11)))
    assert iou(found, limb > 0) > 0.97
    assert cv2.connectedComponents(found.view(np.uint8))[0] == 2


def test_a_black_plate_works_without_a_gauge(kind: str) -> None:
    black = cutter(kind, [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 3)
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    assert not black(image).any()
    image[disc()] = 80
    assert iou(silhouette(black, image), disc()) > 0.99


def test_a_picture_of_another_size_is_refused_in_one_sentence(cut: Cut) -> None:
    with pytest.raises(UserError, match=r"^image: expected 320x240 .* clean plate, found 640x480: [^.]*$"):
        cut(np.zeros((480, 640, 3), np.uint8))


@pytest.mark.parametrize("width", [WIDTH - 3, WIDTH - 31, 40, 33])
def test_any_width_will_do(kind: str, width: int) -> None:
    narrow = cutter(kind, [frame[:, :width] for frame in plate_frames(8)])
    actor = disc(14, (18, 100))
    scene = wall()
    scene[actor] = COLOURS["red"]
    found = silhouette(narrow, exposed(scene, np.random.default_rng(3))[:, :width])
    assert found.shape == (HEIGHT, width)
    assert iou(found, actor[:, :width]) > 0.95


def test_a_silhouette_depends_on_its_own_picture_alone(cut: Cut) -> None:
    rng = np.random.default_rng(13)
    images = []
    for radius in (70, 12, 40, 0):
        scene = wall()
        scene[disc(radius)] = COLOURS["navy"]
        images.append(exposed(scene, rng, rng.uniform(0.9, 1.1)))
    forwards = [cut(image) for image in images]
    backwards = [cut(image) for image in images[::-1]][::-1]
    assert all(np.array_equal(one, other) for one, other in zip(forwards, backwards, strict=True))


def test_pictures_stay_as_they_are(cut: Cut) -> None:
    image = exposed(wall(), np.random.default_rng(12))
    before = image.copy()
    cut(image)
    assert np.array_equal(image, before)


def decode(path: Path, until: int) -> list[Bytes]:
    with av.open(str(path)) as container:
        frames = islice(container.decode(video=0), until)
        return [np.asarray(frame.to_ndarray(format="bgr24"), np.uint8) for frame in frames]


@pytest.mark.parametrize("camera", ["cam01", "cam05", "cam08"])
def test_rendered_studio(shared_takes: Path, camera: str) -> None:
    take = shared_takes / "studio-a"
    segmenter = joint(decode(take / f"background/{camera}.mp4", 30))
    images = decode(take / f"videos/{camera}.mp4", 49)
    for frame in (0, 24, 48):
        path = take / f"reference/silhouettes/{camera}/{frame:06d}.png"
        true = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) > 127
        found = np.asarray(segmenter.trimaps({0: images[frame]})[0] == ACTOR)
        assert iou(found, true) > 0.965
        # What is taken wrongly hugs the outline: not a pixel of shadow away from it.
        near = cv2.dilate(true.view(np.uint8), np.ones((7, 7), np.uint8)) > 0
        assert not np.any(found & ~near)
        assert (found & ~true).sum() < 0.025 * true.sum()
        assert (~found & true).sum() < 0.02 * true.sum()
