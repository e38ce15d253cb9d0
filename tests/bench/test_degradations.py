from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.degradations import EATEN, SPECKS, Degradation, bitten, trimaps_of, with_specks, write_harder
from services.mocap.body.actor import Actor
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import open_take
from services.mocap.take.layout import silhouette_folder
from services.mocap.take.pictures import read_trimaps
from services.mocap.take.tables import write_joints_csv
from services.mocap.types import ACTOR, Mask


def figure() -> Mask:
    """A cross of two bars, 240 x 320."""
    mask = np.zeros((240, 320), bool)
    mask[40:200, 140:170] = mask[90:110, 90:220] = True
    return mask


def contour_of(mask: Mask) -> Mask:
    inner = mask.copy()
    for axis in (0, 1):
        for shift in (1, -1):
            inner &= np.roll(mask, shift, axis)
    return mask & ~inner


@settings(max_examples=20)
@given(seed=st.integers(0, 1000))
def test_about_a_twentieth_of_the_contour_is_bitten_away(seed: int) -> None:
    mask = figure()
    left = bitten(mask, np.random.default_rng(seed))
    assert not (left & ~mask).any()
    contour = contour_of(mask)
    assert EATEN - 0.01 <= 1 - left[contour].mean() <= EATEN + 0.03
    assert 0.97 < left.sum() / mask.sum() < 1


@settings(max_examples=20)
@given(seed=st.integers(0, 1000))
def test_a_hundredth_of_the_picture_is_turned_round(seed: int) -> None:
    mask = figure()
    changed = with_specks(mask, np.random.default_rng(seed)) ^ mask
    assert changed.mean() == pytest.approx(SPECKS, abs=0.001)
    assert changed[mask].any()
    assert changed[~mask].any()


def test_an_empty_silhouette_has_nothing_to_bite_off() -> None:
    empty = np.zeros((20, 30), bool)
    np.testing.assert_array_equal(bitten(empty, np.random.default_rng(0)), empty)


def masks_of(folder: Path, camera: str, frames: int) -> list[Mask]:
    return [trimap == ACTOR for trimap in read_trimaps(silhouette_folder(folder, camera), 0, frames)]


@pytest.mark.parametrize(
    ("degradation", "left"),
    [
        (Degradation.EVERY_OTHER, ["cam01", "cam03", "cam05"]),
        (Degradation.FIRST_HALF, ["cam01", "cam02", "cam03"]),
    ],
)
def test_half_of_the_cameras_see_what_they_saw(
    small_take, tmp_path: Path, degradation: Degradation, left: list[str]
) -> None:
    take = open_take(small_take(n_cameras=5, frames=2, source="silhouettes"))
    actor = Actor(height=1.6)
    silhouettes = trimaps_of(take, tmp_path / "unused")
    write_harder(tmp_path / "half", take, silhouettes, actor, degradation)
    half = open_take(tmp_path / "half")
    assert [camera.name for camera in half.cameras] == left
    assert take_actor(half) == actor
    for name in left:
        np.testing.assert_array_equal(masks_of(tmp_path / "half", name, 2), masks_of(take.folder, name, 2))
    assert not (tmp_path / "unused").exists()


def test_bad_silhouettes_differ_from_frame_to_frame_and_repeat_by_seed(small_take, tmp_path: Path) -> None:
    take = open_take(small_take(frames=2, source="silhouettes"))
    silhouettes = trimaps_of(take, tmp_path / "unused")
    for name in ("one", "other"):
        write_harder(tmp_path / name, take, silhouettes, Actor(), Degradation.NOISE)
    one, other = (masks_of(tmp_path / name, "cam02", 2) for name in ("one", "other"))
    np.testing.assert_array_equal(one, other)
    given = masks_of(take.folder, "cam02", 2)
    changed = [mask ^ before for mask, before in zip(one, given, strict=True)]
    assert all(change.mean() > 0.009 for change in changed)
    assert (changed[0] != changed[1]).any()


def test_trimaps_of_videos_are_segmented(small_take, tmp_path: Path) -> None:
    take = open_take(small_take(frames=2))
    silhouettes = trimaps_of(take, tmp_path / "segmented")
    masks = list(silhouettes(take.cameras[0]))
    assert len(masks) == 2
    assert masks[0].any()


def test_the_truth_goes_with_the_take(small_take, tmp_path: Path) -> None:
    folder = small_take(frames=2, source="silhouettes")
    joints = folder / "reference" / "joints.csv"
    joints.parent.mkdir()
    write_joints_csv(joints, np.arange(2, dtype=np.int32), np.arange(2) / 10, np.ones((2, 15, 3)))
    take = open_take(folder)
    write_harder(tmp_path / "harder", take, trimaps_of(take, tmp_path), Actor(), Degradation.NOISE)
    assert (tmp_path / "harder" / "reference" / "joints.csv").read_bytes() == joints.read_bytes()
