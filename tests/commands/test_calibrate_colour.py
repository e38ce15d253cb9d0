"""Colours by a chart: rendered charts under known casts, and what segmentation then gets to see."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from services.commands.calibrate.colour import calibrate_colour
from services.mocap.calibration.colour_chart import fit_colours, reference_levels
from services.mocap.camera.camera import Camera
from services.mocap.camera.colour import ColourCorrection, encoded_of, linear_of, write_colours
from services.mocap.errors import CalibrationError, UserError
from services.mocap.take.folder import open_take
from services.mocap.take.video import VideoReader
from services.mocap.take.writer import video_writer
from services.mocap.types import ACTOR, Bytes, Floats, Mask
from services.segmentation.background import quick_looks, spread_pictures
from services.segmentation.segmenters import make_segmenter

SmallTake = Callable[..., Path]
CASTS = {
    "warm": [[0.9, 0.08, 0.0], [0.05, 0.8, 0.05], [0.0, 0.1, 0.55]],
    "dim": [[0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.3]],
    "cold and mixed": [[0.6, 0.15, 0.05], [0.1, 0.7, 0.1], [0.1, 0.15, 0.7]],
}
"""What cameras make of linear red, green and blue."""


def chart(turn_deg: float = 8.0, size_px: tuple[int, int] = (320, 240), width_px: int = 160) -> Bytes:
    """The chart before a rough wall, BGR; a third to a half of the picture wide."""
    levels = reference_levels()[:, ::-1]
    square, gap = 24, 5
    print_ = np.full((4 * square + 7 * gap, 6 * square + 9 * gap, 3), 25, np.uint8)
    for i, bgr in enumerate(levels):
        row, column = divmod(i, 6)
        y, x = 2 * gap + row * (square + gap), 2 * gap + column * (square + gap)
        print_[y : y + square, x : x + square] = bgr
    wall = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 40, size_px[::-1]), (0, 0), 5)[..., None]
    picture = np.clip(wall + np.array([120, 125, 130]), 0, 255).astype(np.uint8)
    height, width = print_.shape[:2]
    M = cv2.getRotationMatrix2D((width / 2, height / 2), turn_deg, width_px / width)
    M[:, 2] += np.array(size_px) / 2 - (width / 2, height / 2)
    cv2.warpAffine(print_, M, size_px, picture, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    return picture


def cast(picture: Bytes, matrix: Floats, seed: int = 0, noise: float = 1.5) -> Bytes:
    """What a camera of a cast makes of a picture (…, 3) BGR."""
    seen = encoded_of((linear_of(picture[..., ::-1] / 255) @ np.array(matrix).T).clip(0, 1))[..., ::-1]
    grain = noise * np.random.default_rng(seed).standard_normal(picture.shape)
    return np.clip(np.rint(255 * seen + grain), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("turn_deg", [-20.0, 90.0, 180.0])
@pytest.mark.parametrize("name", CASTS)
def test_a_known_cast_is_undone(name: str, turn_deg: float) -> None:
    fit = fit_colours(cast(chart(turn_deg), CASTS[name]), Path("a.png"))
    assert fit.before.mean() > 10
    assert fit.after.mean() < 1.5
    undone = fit.correction.matrix[:, :3] @ np.array(CASTS[name])
    np.testing.assert_allclose(undone, np.eye(3), atol=0.06)
    np.testing.assert_allclose(fit.correction.matrix[:, 3], 0, atol=0.01)
    clean = chart(turn_deg)
    off = np.abs(fit.correction.apply(cast(clean, CASTS[name], noise=0)).astype(int) - clean)
    assert np.quantile(off, 0.95) <= 6


def test_no_correction_changes_nothing() -> None:
    ramp = np.arange(256, dtype=np.uint8).repeat(3).reshape(16, 16, 3)
    same = ColourCorrection(np.eye(3, 4)).apply(ramp)
    assert same.dtype == np.uint8
    assert np.array_equal(same, ramp)
    brighter = ColourCorrection(np.eye(3, 4) * 2).apply(ramp)
    assert brighter[-1, -1, 0] == 255
    assert (brighter >= ramp).all()


def test_red_green_and_blue_are_not_mixed_up() -> None:
    matrix = np.zeros((3, 4))
    matrix[0, 2], matrix[1, 3] = 1.0, 1.0  # red becomes what blue was, green is full, blue goes
    corrected = ColourCorrection(matrix).apply(np.array([[[200, 90, 10]]], np.uint8))
    assert corrected.tolist() == [[[0, 255, 200]]]


def overexposed() -> Bytes:
    return np.clip(chart().astype(int) * 3, 0, 255).astype(np.uint8)


def in_glare() -> Bytes:
    picture = cast(chart(0.0), np.eye(3))
    light = np.linspace(-1, 1, 320)[None, :, None] * 150
    return np.clip(picture + light, 0, 249).astype(np.uint8)


@pytest.mark.parametrize(
    ("picture", "said"),
    [
        (np.full((240, 320, 3), 120, np.uint8), "no colour chart was found in it: expected a ColorChecker"),
        (overexposed(), "patches are overexposed: expose so that"),
        (cast(chart(), 0.02 * np.eye(3), noise=0), "the chart is too dark, its white patch has"),
        (in_glare(), "off (delta E) after correction: expected a ColorChecker Classic in even light"),
    ],
)
def test_bad_charts_are_said_in_one_sentence(picture: Bytes, said: str) -> None:
    with pytest.raises(CalibrationError) as refused:
        fit_colours(picture, Path("colour/cam01.png"))
    assert str(refused.value).startswith("colour/cam01.png: ")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def write_png(path: Path, picture: Bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(cv2.imencode(".png", picture)[1].tobytes())


def small_chart(matrix: Floats) -> Bytes:
    """In the size of the small take's pictures, 64x48: too small for its patches to be told apart."""
    return cast(cv2.resize(chart(0.0), (64, 48), interpolation=cv2.INTER_AREA), matrix)


def test_pictures_that_are_missing_or_useless_leave_the_take_as_it_is(small_take: SmallTake) -> None:
    folder = small_take()
    with pytest.raises(CalibrationError, match=r"colour/cam01\.png: is missing: expected one picture"):
        calibrate_colour(folder)
    write_png(folder / "colour/cam02.png", small_chart(np.eye(3)))
    with pytest.raises(CalibrationError, match=r"colour/cam02\.png: .* expected a ColorChecker"):
        calibrate_colour(folder)
    write_png(folder / "colour/cam02.png", chart())
    with pytest.raises(UserError, match=r"is 320x240 pixels, but \[cam02\] size"):
        calibrate_colour(folder)
    assert not (folder / "colour.toml").exists()


def test_what_colour_toml_says_is_checked(small_take: SmallTake) -> None:
    folder = small_take()
    for text, said in (
        ("[cam09]\nmatrix = []", "cam09: is no camera of the take: did you mean"),
        ("[cam01]\nmatrix = [[1.0, 0.0, 0.0, 0.0]]", "[cam01] matrix: expected 3 rows of 4 finite numbers"),
        ("cam01 = 3", "cam01: expected a table per camera, found 3"),
        ("[cam01]\nmatrix = 1\nmatric = 2", "[cam01] "),
    ):
        (folder / "colour.toml").write_text(text)
        with pytest.raises(CalibrationError) as refused:
            open_take(folder)
        assert str(refused.value).startswith(f"{folder}/colour.toml: {said}")


def test_a_take_of_charts_is_corrected_camera_by_camera(
    shared_takes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "take"
    folder.mkdir()
    for name in ("take.toml", "calibration.toml"):
        shutil.copy(shared_takes / "studio-a" / name, folder / name)
    for name in ("videos", "background"):
        (folder / name).symlink_to(shared_takes / "studio-a" / name)
    write_png(folder / "colour/cam01.png", cast(chart(), np.array(CASTS["warm"])))
    write_png(folder / "colour/cam03.png", cast(chart(), np.array(CASTS["dim"]), seed=1))
    calibrate_colour(folder)
    printed, warned = capsys.readouterr()
    assert "no picture of a chart from cam02, cam04" in warned
    rows = {line.split()[0]: [float(part) for part in line.split()[1:]] for line in printed.splitlines()[1:3]}
    assert rows.keys() == {"cam01", "cam03"}
    assert all(before > 10 > 1.5 > after for before, after, *_ in rows.values())
    assert open_take(folder).colours.keys() == {"cam01", "cam03"}


def ball_take(folder: Path, matrix: Floats) -> None:
    """Correct cam01 of a take by the inverse of a matrix, in linear light."""
    inverse = np.column_stack([np.linalg.inv(matrix), np.zeros(3)])
    write_colours(folder / "colour.toml", {"cam01": (ColourCorrection(inverse), 9.0, 1.0)})


def test_all_pictures_of_a_take_are_corrected(small_take: SmallTake) -> None:
    folder = small_take()
    raw = open_take(folder)
    ball_take(folder, 0.5 * np.eye(3))
    take = open_take(folder)
    for camera, factor in zip(take.cameras, (2.0, 1.0), strict=True):
        for corrected, plain in (
            (next(iter(take.video(camera))), next(iter(raw.video(camera)))),
            (next(take.background(camera)), next(raw.background(camera))),
            (spread_pictures(take, camera, 3)[0], spread_pictures(raw, camera, 3)[0]),
            (quick_looks(take, camera, 3)[0], quick_looks(raw, camera, 3)[0]),
        ):
            expected = 255 * encoded_of((factor * linear_of(plain / 255)).clip(0, 1))
            np.testing.assert_allclose(corrected, expected, atol=1)


def test_a_plate_of_another_camera_setting_serves_once_corrected(
    small_take: SmallTake, ball_silhouette: Callable[[Camera, int], Mask]
) -> None:
    """The screen is green only to who undoes the cast: chroma works on corrected pictures."""
    folder = small_take()
    take = open_take(folder)
    matrix = np.array([[0.45, 0.5, 0.05], [0.5, 0.45, 0.05], [0.05, 0.05, 0.9]])
    shutil.rmtree(folder / "background")
    for camera in take.cameras:
        with video_writer(folder / f"videos/{camera.name}.mp4", 64, 48, 10.0) as video:
            for frame in range(4):
                picture = np.full((48, 64, 3), (70, 175, 40), np.uint8)
                picture[ball_silhouette(camera, frame)] = (60, 70, 200)
                video.write(cast(picture, matrix, noise=0))

    def found() -> Mask:
        again = open_take(folder)
        (trimap,) = next(make_segmenter(again, again.cameras[:1], "chroma:28af46").trimaps(0, 1))
        return np.asarray(trimap == ACTOR)

    true = ball_silhouette(take.cameras[0], 0)
    before = found()
    ball_take(folder, matrix)
    after = found()
    assert (before & true).sum() / (before | true).sum() < 0.5
    assert (after & true).sum() / (after | true).sum() > 0.7


def test_videos_without_a_correction_are_read_as_they_are(small_take: SmallTake) -> None:
    path = small_take() / "videos/cam01.mp4"
    with VideoReader(path) as plain, VideoReader(path, colour=ColourCorrection(np.eye(3, 4))) as same:
        assert all(np.array_equal(a, b) for a, b in zip(plain, same, strict=True))
