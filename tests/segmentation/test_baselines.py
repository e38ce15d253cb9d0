"""The published test, one camera by itself: what differs from the clean plate and is no shadow."""

import cv2
import numpy as np
import pytest
from wall_scene import COLOURS, disc, exposed, iou, plate_frames, wall

from services.mocap.types import ACTOR, Bytes, Mask
from services.segmentation import baselines
from services.segmentation.baselines import PaperTest


@pytest.fixture(scope="module")
def paper() -> PaperTest:
    return PaperTest.learn(plate_frames(12))


def silhouette(test: PaperTest, image: Bytes) -> Mask:
    return np.asarray(test.trimap(image) == ACTOR)


@pytest.mark.parametrize("colour", COLOURS)
def test_actor_stays_and_large_shadow_beside_goes(paper: PaperTest, colour: str) -> None:
    rng = np.random.default_rng(1)
    actor, shadow = disc(), disc(45, (215, 170))
    for ratio in (0.5, 0.7, 0.9):
        scene = wall()
        scene[shadow] *= ratio
        scene[actor] = COLOURS[colour]
        found = silhouette(paper, exposed(scene, rng, rng.uniform(0.9, 1.1)))
        assert iou(found, actor) > 0.98
        assert not found[shadow & ~disc(43)].any()


def test_soft_and_tinted_shadow_goes(paper: PaperTest) -> None:
    depth = cv2.GaussianBlur(disc(45).astype(np.float64), (0, 0), 6)[..., None]
    scene = wall() * (1 - depth * np.array([0.36, 0.40, 0.43]))  # the sky's share is left, a little blue
    assert not silhouette(paper, exposed(scene, np.random.default_rng(2))).any()


def test_nothing_is_unsure(paper: PaperTest) -> None:
    scene = wall()
    scene[disc()] *= 0.45  # between shadow and actor
    trimap = paper.trimap(exposed(scene, np.random.default_rng(2)))
    assert set(np.unique(trimap)) == {0, ACTOR}


def test_the_darkest_shadow_decides_what_is_shadow(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = wall()
    scene[disc()] *= 0.6
    image = exposed(scene, np.random.default_rng(2))
    assert not silhouette(PaperTest.learn(plate_frames(8)), image).any()
    monkeypatch.setattr(baselines, "_SHADOW_RATIO_MIN", 0.8)
    assert iou(silhouette(PaperTest.learn(plate_frames(8)), image), disc()) > 0.98


@pytest.mark.parametrize("gain", [0.7, 0.95, 1.0, 1.05, 1.35])
def test_hardly_a_pixel_of_an_empty_scene_differs(paper: PaperTest, gain: float) -> None:
    assert paper.foreground(exposed(wall(), np.random.default_rng(4), gain)).mean() < 2e-4


def test_a_change_of_light_beyond_flicker_is_not_hidden(paper: PaperTest) -> None:
    assert paper.foreground(exposed(wall(), np.random.default_rng(6), 1.6)).mean() > 0.9


def test_frames_may_come_from_a_generator_and_images_stay_as_they_are(paper: PaperTest) -> None:
    streamed = PaperTest.learn(frame for frame in plate_frames(12))
    image = exposed(wall(), np.random.default_rng(12))
    before = image.copy()
    assert np.array_equal(streamed.foreground(image), paper.foreground(image))
    assert np.array_equal(image, before)
