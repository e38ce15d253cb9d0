"""Several cameras' silhouettes together, in a made-up room with known truth."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from rig_scene import (
    BLUE,
    DARK_GREY,
    GREEN,
    Blob,
    Colour,
    Moment,
    iou,
    joint,
    joint_of,
    moment,
    noisy,
    person,
    plates,
    raised,
    render,
    ring,
    taught,
)

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.take.writer import video_writer
from services.mocap.types import ACTOR, BACKGROUND, Bytes, Floats, Mask
from services.segmentation.baselines import PaperTest
from services.segmentation.joint import JointMatte

CAMERAS = ring(5)
STANDING = person(x=0.1, y=-0.2)


def walk(cameras: Sequence[Camera], clothes: Colour = DARK_GREY, floor_m: float = 0.0) -> list[Moment]:
    return [
        moment(cameras, raised(person(clothes, x=0.15 * k - 0.3, y=0.1 * k), floor_m), k, floor_m)
        for k in range(4)
    ]


def learnt(cameras: Sequence[Camera], clothes: Colour = DARK_GREY, floor_m: float = 0.0) -> JointMatte:
    return taught(joint(cameras, floor_m), [m.images for m in walk(cameras, clothes, floor_m)])


@pytest.fixture(scope="module")
def walked() -> list[Moment]:
    return walk(CAMERAS)


@pytest.fixture(scope="module")
def segmenter(walked: list[Moment]) -> JointMatte:
    """Has seen somebody in dark grey."""
    return taught(joint(CAMERAS), [m.images for m in walked])


@pytest.fixture(scope="module")
def standing() -> Moment:
    return moment(CAMERAS, STANDING, 77)


def visible(camera: Camera, blobs: Sequence[Blob], k: int) -> Mask:
    """(H, W) where a camera sees one of some blobs, its rim left out."""
    others = [blob for i, blob in enumerate(blobs) if i != k]
    with_it, without = render(camera, blobs).colours, render(camera, others).colours
    part = render(camera, [blobs[k]]).actor & (np.abs(with_it - without).max(axis=2) > 1)
    return np.asarray(cv2.erode(part.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def test_dark_grey_clothes_before_grey_walls_stay_and_the_shadow_goes(
    segmenter: JointMatte, standing: Moment
) -> None:
    published = [PaperTest.learn(frames) for frames in plates(CAMERAS)]
    found = segmenter.trimaps(standing.images)
    assert sorted(found) == list(range(5))
    for c, view in enumerate(standing.views):
        assert iou(found[c], view.actor) > 0.93
        assert (found[c][view.actor] == BACKGROUND).mean() < 0.03
        assert (found[c][view.shadow] == ACTOR).mean() < 0.03
        assert iou(published[c].trimap(standing.images[c]), view.actor) < 0.6


def test_clothes_as_the_walls_stay() -> None:
    clothes: Colour = (122.0, 122.0, 120.0)
    segmenter, seen = learnt(CAMERAS, clothes), moment(CAMERAS, person(clothes, x=0.1, y=-0.2), 53)
    for c, trimap in segmenter.trimaps(seen.images).items():
        assert iou(trimap, seen.views[c].actor) > 0.9


def test_silhouettes_are_good_before_anything_was_learnt(standing: Moment) -> None:
    found = joint(CAMERAS).trimaps(standing.images)
    assert min(iou(found[c], view.actor) for c, view in enumerate(standing.views)) > 0.85


def test_what_is_learnt_makes_silhouettes_better(segmenter: JointMatte, standing: Moment) -> None:
    before, after = (s.trimaps(standing.images) for s in (joint(CAMERAS), segmenter))
    true = [view.actor for view in standing.views]
    lost_before, lost_after = (
        sum(int((found[c][true[c]] == BACKGROUND).sum()) for c in range(5)) for found in (before, after)
    )
    assert lost_after < lost_before / 2


def test_lens_distortion_does_no_harm() -> None:
    cameras = ring(4, lens=(-0.12, 0.06, 0.001, -0.0005))
    segmenter, seen = learnt(cameras), moment(cameras, STANDING, 78)
    for c, trimap in segmenter.trimaps(seen.images).items():
        assert iou(trimap, seen.views[c].actor) > 0.9
        assert (trimap[seen.views[c].shadow] == ACTOR).mean() < 0.05


def test_a_floor_elsewhere_is_found_by_its_shadows() -> None:
    cameras = ring(4)
    segmenter = learnt(cameras, floor_m=0.35)
    seen = moment(cameras, raised(STANDING, 0.35), 79, 0.35)
    for c, trimap in segmenter.trimaps(seen.images).items():
        assert iou(trimap, seen.views[c].actor) > 0.9
        assert (trimap[seen.views[c].shadow] == ACTOR).mean() < 0.05


def drifting(colours: Floats, seed: int, phase: float) -> Floats:
    """Colours (H, W, 3) in light that is up to 15 % off, smoothly over the picture; it changes with phase."""
    size = colours.shape[1::-1]
    grids = np.random.default_rng(seed).uniform(-1, 1, (2, 4, 5))
    begin, end = (cv2.resize(grid, size, interpolation=cv2.INTER_CUBIC) for grid in grids)
    light = (1 - phase) * begin / np.abs(begin).max() + phase * end / np.abs(end).max()
    return np.asarray(colours * (1 + 0.15 * light)[..., None])


def test_an_empty_stage_in_drifting_light_is_all_background(segmenter: JointMatte) -> None:
    empty, rng = [render(camera).colours for camera in CAMERAS], np.random.default_rng(5)
    fresh = joint(CAMERAS)
    for frame in range(60):
        images = {c: noisy(drifting(colours, c, frame / 59), rng) for c, colours in enumerate(empty)}
        for one in (segmenter, fresh):
            assert not any(trimap.any() for trimap in one.trimaps(images).values())


def test_an_arm_of_a_colour_that_was_never_seen_stays(segmenter: JointMatte) -> None:
    blobs = [*STANDING[:5], replace(STANDING[5], colour=GREEN)]
    found = segmenter.trimaps(moment(CAMERAS, blobs, 50).images)
    for c, camera in enumerate(CAMERAS):
        arm = visible(camera, blobs, 5)
        assert arm.sum() > 5
        assert (found[c][arm] == ACTOR).mean() > 0.98


def test_a_coat_thrown_through_the_room_is_foreground_everywhere(segmenter: JointMatte) -> None:
    blobs = [*STANDING, Blob((-0.7, 0.6, 1.4), (0.2, 0.2, 0.12), BLUE)]
    seen = moment(CAMERAS, blobs, 51)
    found = segmenter.trimaps(seen.images)
    for c, camera in enumerate(CAMERAS):
        assert (found[c][visible(camera, blobs, 6)] == ACTOR).mean() > 0.98
        assert iou(found[c], seen.views[c].actor) > 0.92


@pytest.mark.parametrize("colour", [BLUE, (20.0, 20.0, 20.0), (240.0, 240.0, 240.0)])
def test_what_one_camera_alone_sees_is_dropped(segmenter: JointMatte, colour: Colour) -> None:
    nobody = moment(CAMERAS, [], 52)
    for one in (segmenter, joint(CAMERAS)):
        for c in range(5):
            for at_px in ((60, 60), (120, 90), (200, 100)):
                images = dict(nobody.images)
                images[c] = np.ascontiguousarray(cv2.circle(images[c].copy(), at_px, 10, colour, cv2.FILLED))
                assert not any((trimap == ACTOR).any() for trimap in one.trimaps(images).values())


def test_legs_that_furniture_hides_from_some_cameras_stay_in_the_others() -> None:
    """A table that is in the plates covers the lower part of two cameras' pictures."""
    cameras, hidden_from = ring(7), (0, 3)
    empty = [noisy(render(camera).colours, np.random.default_rng(5)) for camera in cameras]
    pictures, views = [], []
    for k in range(6):
        seen = moment(cameras, person(x=0.04 * k, y=-0.02 * k), k)
        for c in hidden_from:
            rows = np.flatnonzero(seen.views[c].actor.any(axis=1))
            table = slice(rows[0] + 6 * np.ptp(rows) // 10, None)
            seen.images[c][table] = empty[c][table]
        pictures.append(seen.images)
        views.append(seen.views)
    segmenter = taught(joint(cameras), pictures)
    found = np.zeros(2)
    for c, trimap in segmenter.trimaps(pictures[2]).items():
        actor = views[2][c].actor
        rows = np.flatnonzero(actor.any(axis=1))
        feet = actor.copy()
        feet[: rows[-1] - np.ptp(rows) // 6] = False
        if c not in hidden_from:
            assert iou(trimap, actor) > 0.92
            found += (trimap[feet] == ACTOR).sum(), feet.sum()
    assert found[0] > 0.75 * found[1], "none where nothing is known of the table"


def test_a_moment_without_some_cameras(segmenter: JointMatte, standing: Moment) -> None:
    for there in ((0, 1, 2, 3), (0, 2, 4), (1, 4), (3,)):
        found = segmenter.trimaps({c: standing.images[c] for c in there})
        assert tuple(sorted(found)) == there
        if len(there) > 1:
            assert min(iou(found[c], standing.views[c].actor) for c in there) > 0.8
    assert segmenter.trimaps({}) == {}


@pytest.mark.parametrize("n_cameras", [1, 2, 3])
def test_few_cameras_will_do(n_cameras: int) -> None:
    cameras = CAMERAS[:n_cameras]
    clothes: Colour = (150.0, 60.0, 40.0)
    segmenter, seen = learnt(cameras, clothes), moment(cameras, person(clothes, x=0.1, y=-0.2), 54)
    for c, trimap in segmenter.trimaps(seen.images).items():
        assert iou(trimap, seen.views[c].actor) > 0.93
        assert (trimap[seen.views[c].shadow] == ACTOR).mean() < 0.05


def test_cameras_may_be_of_unlike_sizes() -> None:
    cameras = [ring(4, *size)[c] for c, size in enumerate([(240, 180), (200, 150), (321, 203), (200, 240)])]
    segmenter, seen = learnt(cameras), moment(cameras, STANDING, 55)
    for c, trimap in segmenter.trimaps(seen.images).items():
        assert trimap.shape == (cameras[c].height_px, cameras[c].width_px)
        assert iou(trimap, seen.views[c].actor) > 0.88


def test_a_picture_of_another_size_is_refused(segmenter: JointMatte, standing: Moment) -> None:
    images: dict[int, Bytes] = {**standing.images, 3: np.zeros((120, 160, 3), np.uint8)}
    with pytest.raises(UserError, match=r"^image: expected 240x180 .* clean plate, found 160x120: [^.]*$"):
        segmenter.trimaps(images)


def test_trimaps_depend_on_their_own_moment_alone(
    segmenter: JointMatte, standing: Moment, walked: list[Moment]
) -> None:
    moments = [m.images for m in walked] + [standing.images]
    moments += [moment(CAMERAS, [], 3).images, {c: standing.images[c] for c in (0, 2, 3)}]
    forwards = [segmenter.trimaps(images) for images in moments]
    backwards = [segmenter.trimaps(images) for images in moments[::-1]][::-1]
    for one, other in zip(forwards, backwards, strict=True):
        assert one.keys() == other.keys()
        for c in one:
            np.testing.assert_array_equal(one[c], other[c])


def test_learning_twice_from_the_same_is_the_same(
    segmenter: JointMatte, standing: Moment, walked: list[Moment]
) -> None:
    again = taught(joint(CAMERAS), [m.images for m in walked]).trimaps(standing.images)
    for c, trimap in segmenter.trimaps(standing.images).items():
        np.testing.assert_array_equal(trimap, again[c])


def test_what_is_learnt_does_not_count_before_the_conclusion(standing: Moment, walked: list[Moment]) -> None:
    segmenter = joint(CAMERAS)
    before = segmenter.trimaps(standing.images)
    for learnt_from in walked:
        segmenter.learn(learnt_from.images)
    between = segmenter.trimaps(standing.images)
    segmenter.conclude()
    after = segmenter.trimaps(standing.images)
    assert all(np.array_equal(before[c], between[c]) for c in range(5))
    assert not all(np.array_equal(before[c], after[c]) for c in range(5))


def test_no_camera_is_of_consequence_by_its_place() -> None:
    order = [2, 0, 3, 1]
    cameras = ring(4)
    shuffled = [cameras[c] for c in order]
    seen = moment(cameras, STANDING, 56)
    pictures = walk(cameras)
    found = taught(joint(cameras), [m.images for m in pictures]).trimaps(seen.images)

    def turned(images: dict[int, Bytes]) -> dict[int, Bytes]:
        return {k: images[c] for k, c in enumerate(order)}

    known = plates(cameras)
    other = taught(joint_of(shuffled, [known[c] for c in order]), [turned(m.images) for m in pictures])
    for k, trimap in other.trimaps(turned(seen.images)).items():
        np.testing.assert_array_equal(trimap, found[order[k]])


def compressed(pictures: Sequence[Bytes], file: Path) -> list[Bytes]:
    """Pictures as they come out of a video that an encoder made much smaller."""
    height_px, width_px = pictures[0].shape[:2]
    with video_writer(file, width_px, height_px, 25.0, crf=30) as video:
        for picture in pictures:
            video.write(picture)
    with av.open(file) as container:
        return [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]


def test_errors_of_a_codec_around_the_actor_are_background(tmp_path: Path) -> None:
    cameras = CAMERAS[:3]
    seen = [moment(cameras, person(x=0.04 * k - 0.2, y=0.03 * k), 200 + k) for k in range(12)]
    empty, pictures = (
        [compressed(of_camera, tmp_path / f"{c}.mp4") for c, of_camera in enumerate(of_cameras)]
        for of_cameras in (
            plates(cameras, n=24),
            [[m.images[c] for m in seen] for c in range(len(cameras))],
        )
    )
    moments = [dict(enumerate(images)) for images in zip(*pictures, strict=True)]
    found = taught(joint_of(cameras, empty), moments).trimaps(moments[7])
    assert min(iou(found[c], view.actor) for c, view in enumerate(seen[7].views)) > 0.8
