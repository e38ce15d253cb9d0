"""Pictures larger than take.toml's longest_side are reduced wherever a take is read."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rotation_tag import tag_a_quarter_turn
from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import resized_trimap
from services.mocap.take.folder import Take, open_take
from services.mocap.take.settings import LONGEST_SIDE, read_take_file
from services.mocap.take.writer import write_picture
from services.mocap.types import ACTOR, UNSURE, Bytes, Floats
from services.segmentation.files import write_silhouettes
from services.segmentation.segmenters import make_segmenter

SmallTake = Callable[..., Path]


def _whole_and_reduced(folder: Path) -> tuple[Take, Take]:
    """A take of pictures of 64 x 48 pixels as it is, and reduced to half of that."""
    whole = open_take(folder)
    settings = folder / "take.toml"
    settings.write_text(f"longest_side = 32\n{settings.read_text()}")
    return whole, open_take(folder)


def _ball_px(bgr: Bytes) -> Floats:
    """Column and row of the middle of what is red."""
    red = np.clip(bgr[..., 2].astype(float) - bgr[..., 1] - 20, 0, None)
    rows, columns = np.mgrid[: bgr.shape[0], : bgr.shape[1]]
    return np.array([(red * columns).sum(), (red * rows).sum()]) / red.sum()


def test_pictures_and_plates_have_the_reduced_camera_s_size(small_take: SmallTake) -> None:
    whole, reduced = _whole_and_reduced(small_take(n_cameras=1))
    (of_file,), (camera,) = reduced.calibrated, reduced.cameras
    assert of_file.size_px == (64, 48)
    assert camera.size_px == (32, 24)
    np.testing.assert_allclose(camera.K[:2, :2], of_file.K[:2, :2] / 2)
    with whole.video(whole.cameras[0]) as files, reduced.video(camera) as video:
        for of_file_bgr, bgr in zip(files, video, strict=True):
            expected = np.asarray(cv2.resize(of_file_bgr, (32, 24), interpolation=cv2.INTER_AREA), np.uint8)
            assert bgr.shape == (24, 32, 3)
            assert np.abs(bgr.astype(int) - expected).mean() < 2
            # readers disagree by half a pixel of the file on where its colours are
            np.testing.assert_allclose(_ball_px(bgr), _ball_px(expected), atol=0.26)
    assert [plate.shape for plate in reduced.background(camera)] == [(24, 32, 3)] * 2


@pytest.mark.parametrize(
    ("widths_px", "expected_px"),
    [([320, 640, 320], [320, 640, 320]), ([1280, 320, 320], [640, 320, 320]),
     ([160, 960, 960, 960], [160, 960, 960, 960]), ([320, 1280, 1280, 320], [320, 640, 640, 320])],
)  # fmt: skip
def test_few_large_cameras_do_not_outvote_the_others(
    small_take: SmallTake,
    small_cameras: Callable[[int], list[Camera]],
    widths_px: list[int],
    expected_px: list[int],
) -> None:
    take = open_take(small_take(n_cameras=1))
    cameras = [small_cameras(1)[0].resized(width, width * 3 // 4) for width in widths_px]
    assert [camera.width_px for camera in replace(take, calibrated=tuple(cameras)).cameras] == expected_px


def test_a_plate_that_is_a_picture_is_reduced(small_take: SmallTake) -> None:
    whole, reduced = _whole_and_reduced(small_take(n_cameras=1, clean_plate="picture"))
    (of_file,), (plate,) = whole.background(whole.cameras[0]), reduced.background(reduced.cameras[0])
    np.testing.assert_array_equal(plate, cv2.resize(of_file, (32, 24), interpolation=cv2.INTER_AREA))


@pytest.mark.parametrize("is_turned", [False, True])
def test_single_pictures_are_those_of_the_video(small_take: SmallTake, *, is_turned: bool) -> None:
    folder = small_take(n_cameras=1)
    if is_turned:
        shutil.rmtree(folder / "background")
        tag_a_quarter_turn(folder / "videos" / "cam01.mp4", height_px=48)
        text = (folder / "calibration.toml").read_text().replace("    64,\n    48,\n", "    48,\n    64,\n")
        (folder / "calibration.toml").write_text(text)
    _, take = _whole_and_reduced(folder)
    picker = take.picker(take.cameras[0])
    with take.video(take.cameras[0]) as video:
        for frame, picture in enumerate(video):
            assert picture.shape == ((32, 24, 3) if is_turned else (24, 32, 3))
            np.testing.assert_array_equal(picker.read(frame), picture)


def test_silhouettes_are_reduced(small_take: SmallTake) -> None:
    folder = small_take(source="silhouettes", n_cameras=1, frames=1)
    grey = cv2.imread(str(folder / "silhouettes/cam01/000000.png"), cv2.IMREAD_GRAYSCALE)
    grey[:, :20][grey[:, :20] == ACTOR] = UNSURE
    write_picture(folder / "silhouettes/cam01/000000.png", grey)
    whole, reduced = _whole_and_reduced(folder)
    (of_file,), (trimap,) = whole.trimaps(whole.cameras[0]), reduced.trimaps(reduced.cameras[0])
    assert trimap.shape == (24, 32)
    np.testing.assert_array_equal(trimap, resized_trimap(of_file, reduced.cameras[0]))


def test_by_default_only_large_pictures_are_reduced(small_take: SmallTake) -> None:
    folder = small_take()
    assert "longest_side" not in (folder / "take.toml").read_text()
    assert read_take_file(folder / "take.toml").longest_side == LONGEST_SIDE
    take = open_take(folder)
    assert all(a is b for a, b in zip(take.cameras, take.calibrated, strict=True))


def test_segment_writes_files_that_fit_the_calibration(small_take: SmallTake, tmp_path: Path) -> None:
    _, take = _whole_and_reduced(small_take("videos", frames=2))
    write_silhouettes(take, tmp_path / "out", lambda: None, "paper")
    (take.folder / "silhouettes").symlink_to(tmp_path / "out" / "silhouettes")
    again = open_take(take.folder)
    assert again.source == "silhouettes"
    made = make_segmenter(take, take.cameras, "paper").source.raw_moments(0, 2)
    for moment, *trimaps in zip(made, *map(again.trimaps, again.cameras), strict=True):
        assert all((trimap == ACTOR).any() for trimap in trimaps)
        for ours, theirs in zip(moment.trimaps, trimaps, strict=True):
            np.testing.assert_array_equal(ours, theirs)
