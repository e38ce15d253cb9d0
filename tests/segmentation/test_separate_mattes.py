"""Blobs that only one camera sees go; what several see, and what nobody can judge, stays."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.types import ACTOR, UNSURE, Bytes, Mask, Trimap
from services.segmentation.mattes import SeparateMattes

Cameras = Callable[[int], list[Camera]]
Ball = Callable[[Camera, int], Mask]


class Shown:
    """A matte that takes its pictures for what they show."""

    def trimap(self, image_bgr: Bytes, /) -> Trimap:
        return np.ascontiguousarray(image_bgr[..., 0])


def seen(cameras: list[Camera], ball: Ball) -> tuple[list[Camera], list[Mask]]:
    return cameras, [ball(camera, 2) for camera in cameras]


def kept_trimaps(cameras: list[Camera], trimaps: Sequence[Trimap]) -> list[Trimap]:
    group = SeparateMattes(cameras, [Shown()] * len(cameras))
    found = group.trimaps({c: np.repeat(trimap[..., None], 3, axis=2) for c, trimap in enumerate(trimaps)})
    return [found[c] for c in range(len(cameras))]


def kept_of(cameras: list[Camera], masks: list[Mask]) -> list[Mask]:
    """What is surely actor and kept, where nothing is unsure."""
    return [trimap == ACTOR for trimap in kept_trimaps(cameras, [trimap_of(mask) for mask in masks])]


def with_blob(mask: Mask) -> Mask:
    added = mask.copy()
    added[4:14, 2:8] = True
    return added


def test_a_passer_by_in_one_camera_goes(small_cameras: Cameras, ball_silhouette: Ball) -> None:
    cameras, masks = seen(small_cameras(6), ball_silhouette)
    for c in range(6):
        shown = [with_blob(mask) if k == c else mask for k, mask in enumerate(masks)]
        for kept, true in zip(kept_of(cameras, shown), masks, strict=True):
            assert np.array_equal(kept, true)


def test_the_actor_may_be_in_pieces(small_cameras: Cameras, ball_silhouette: Ball) -> None:
    cameras, masks = seen(small_cameras(6), ball_silhouette)
    cut = masks[1].copy()
    cut[:, 30:33] = False
    shown = [masks[0], cut, *masks[2:]]
    assert all(np.array_equal(kept, mask) for kept, mask in zip(kept_of(cameras, shown), shown, strict=True))


def test_one_camera_that_misses_a_piece_takes_it_from_no_other(
    small_cameras: Cameras, ball_silhouette: Ball
) -> None:
    cameras, masks = seen(small_cameras(6), ball_silhouette)
    masks[1][:, 30:33] = False
    masks[4][24:] = False
    assert np.array_equal(kept_of(cameras, masks)[1], masks[1])


@pytest.mark.parametrize("n_cameras", [2, 3])
def test_few_cameras_cannot_judge(small_cameras: Cameras, ball_silhouette: Ball, n_cameras: int) -> None:
    cameras, masks = seen(small_cameras(n_cameras), ball_silhouette)
    shown = [with_blob(masks[0]), *masks[1:]]
    assert np.array_equal(kept_of(cameras, shown)[0], shown[0])


def test_a_camera_that_fits_nowhere_is_left_to_others_to_judge(
    small_cameras: Cameras, ball_silhouette: Ball
) -> None:
    cameras, masks = seen(small_cameras(6), ball_silhouette)
    elsewhere = np.zeros_like(masks[0])
    elsewhere[2:10, 2:10] = elsewhere[38:46, 2:8] = True
    shown = [elsewhere, *masks[1:]]
    assert np.array_equal(kept_of(cameras, shown)[0], elsewhere)


def test_nobody_in_view(small_cameras: Cameras, ball_silhouette: Ball) -> None:
    cameras, masks = seen(small_cameras(5), ball_silhouette)
    nothing = [np.zeros_like(mask) for mask in masks]
    assert not np.any(kept_of(cameras, nothing))
    blobs = [with_blob(nothing[0]) | np.roll(with_blob(nothing[0]), 20, axis=1), *nothing[1:]]
    assert np.array_equal(kept_of(cameras, blobs)[0], blobs[0])


def test_unsure_pixels_leave_room_and_stay(small_cameras: Cameras, ball_silhouette: Ball) -> None:
    cameras, masks = seen(small_cameras(6), ball_silhouette)
    trimaps = [trimap_of(mask) for mask in masks]
    trimaps[0] = trimap_of(with_blob(masks[0]))
    trimaps[0][40:] = UNSURE
    dropped = kept_trimaps(cameras, trimaps)[0]
    assert np.array_equal(dropped == ACTOR, masks[0] & (trimaps[0] != UNSURE))
    assert np.array_equal(dropped == UNSURE, trimaps[0] == UNSURE)
    for trimap in trimaps[1:]:
        trimap[trimap != ACTOR] = UNSURE  # for all they know there may be something
    assert np.array_equal(kept_trimaps(cameras, trimaps)[0], trimaps[0])
