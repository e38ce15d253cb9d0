import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
import pytest

from services.mocap.take.folder import open_take
from services.mocap.take.writer import write_picture
from services.mocap.types import ACTOR, BACKGROUND, UNSURE

SmallTake: TypeAlias = Callable[..., Path]
Refusal: TypeAlias = Callable[[Path], str]


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


def _flip_a_bit(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[data.index(b"IDAT") + 8] ^= 1
    path.write_bytes(data)


def _other_size(path: Path) -> None:
    write_picture(path, np.zeros((64, 48), np.bool_))


def _zeros_and_ones(path: Path) -> None:
    write_picture(path, np.ones((48, 64), np.uint8))


def _no_png(path: Path) -> None:
    path.write_bytes(b"GIF89a")


def _leave_frames_to_the_files(folder: Path, frames: int = 4) -> None:
    settings = folder / "take.toml"
    settings.write_text(settings.read_text().replace(f"frames = {frames}\n", ""))


@pytest.mark.parametrize(
    ("spoil", "frame", "expected"),
    [
        (_empty, 2, "is empty (0 bytes): export it again"),
        (Path.unlink, 2, "is missing: expected a silhouette for each of the frames = 4 of take.toml"),
        (_cut, 3, "is damaged or cut off: export it again"),
        (_flip_a_bit, 1, "is damaged or cut off: export it again"),
        (_no_png, 1, "is not a PNG file: expected a PNG of 64x48 pixels"),
        (
            _other_size,
            2,
            "is 48x64 pixels, but [cam02] size in calibration.toml is 64x48: turn the pictures by a quarter "
            "turn (ffmpeg -i IN -vf transpose=1 OUT; transpose=2 if they are then upside down), or calibrate "
            "with pictures as these",
        ),
    ],
)
def test_a_bad_silhouette(
    small_take: SmallTake, refusal: Refusal, spoil: Callable[[Path], None], frame: int, expected: str
) -> None:
    folder = small_take(source="silhouettes")
    spoil(folder / f"silhouettes/cam02/00000{frame}.png")
    assert refusal(folder) == f"silhouettes/cam02/00000{frame}.png: {expected}"


def test_silhouettes_of_other_greys(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(source="silhouettes")
    for frame in range(4):
        write_picture(folder / f"silhouettes/cam02/00000{frame}.png", np.full((48, 64), frame > 0, np.uint8))
    assert refusal(folder) == (
        "silhouettes/cam02/000001.png: its brightest grey is 1: expected 0 outside the actor, 255 inside"
    )


def test_a_soft_matte_of_nobody_is_empty(small_take: SmallTake) -> None:
    folder = small_take(source="silhouettes")
    for frame in (0, 2):
        write_picture(folder / f"silhouettes/cam02/00000{frame}.png", np.full((48, 64), 60, np.uint8))
    take = open_take(folder)
    assert [trimap.any() for trimap in take.trimaps(take.cameras[1], 0, 4)] == [False, True, False, True]


def test_silhouettes_that_are_unsure_are_no_other_greys(small_take: SmallTake) -> None:
    folder = small_take(source="silhouettes", unsure=[64, 191])
    for frame in range(4):
        write_picture(folder / f"silhouettes/cam02/00000{frame}.png", np.full((48, 64), 100, np.uint8))
    take = open_take(folder)
    assert all((trimap == UNSURE).all() for trimap in take.trimaps(take.cameras[1], 0, 4))


def test_a_cut_out_is_where_it_is_opaque(small_take: SmallTake) -> None:
    folder = small_take(source="silhouettes")
    cut_out = np.full((48, 64, 4), 255, np.uint8)
    cut_out[..., 3] = 0
    cut_out[10:20, 5:9] = 10, 10, 30, 255  # dark clothes
    write_picture(folder / "silhouettes/cam02/000001.png", cut_out)
    take = open_take(folder)
    (trimap,) = take.trimaps(take.cameras[1], 1, 2)
    np.testing.assert_array_equal(trimap == ACTOR, cut_out[..., 3] == 255)


def test_16_bit_greys(small_take: SmallTake) -> None:
    folder = small_take(source="silhouettes")
    deep = np.zeros((48, 64), np.uint16)
    deep[10:20], deep[30] = 65535, 120 * 256  # the latter is 120 of 255
    cv2.imwrite(str(folder / "silhouettes/cam02/000001.png"), deep)
    take = open_take(folder)
    (trimap,) = take.trimaps(take.cameras[1], 1, 2)
    np.testing.assert_array_equal(trimap == ACTOR, deep == 65535)


def test_silhouettes_of_different_lengths(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(source="silhouettes", frames=8)
    _leave_frames_to_the_files(folder, 8)
    for frame in range(4, 8):
        (folder / f"silhouettes/cam02/00000{frame}.png").unlink()
    assert refusal(folder).startswith("silhouettes/cam02: has 4 frames, but cam01 has 8: cut all cameras to")


def test_a_camera_without_silhouettes_among_others(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(source="silhouettes")
    shutil.rmtree(folder / "silhouettes/cam02")
    assert refusal(folder).startswith("silhouettes/cam02: is missing: expected the silhouettes of cam02")


@pytest.mark.parametrize(
    ("name", "there"),
    [
        ("{:04d}.png", "the first file there is 0000.png"),
        ("{:06d}.PNG", "the first file there is 000000.PNG"),
        ("{:06d}.jpg", "there is no PNG picture"),
    ],
)
@pytest.mark.parametrize("is_stated", [True, False])
def test_silhouettes_that_are_named_in_another_way(
    small_take: SmallTake, refusal: Refusal, name: str, there: str, is_stated: bool
) -> None:
    folder = small_take(source="silhouettes")
    for frame, path in enumerate(sorted((folder / "silhouettes/cam02").iterdir())):
        path.rename(path.with_name(name.format(frame)))
    if not is_stated:
        _leave_frames_to_the_files(folder)
    assert refusal(folder) == (
        "silhouettes/cam02/000000.png: is missing: expected a silhouette for each frame, named 000000.png, "
        f"000001.png and so on, but {there}"
    )


def test_silhouettes_that_are_numbered_from_1(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(source="silhouettes")
    (folder / "silhouettes/cam01/000000.png").rename(folder / "silhouettes/cam01/000004.png")
    assert refusal(folder).endswith("and so on, but the first file there is 000001.png")


def test_a_gap_in_silhouettes_where_no_number_of_frames_is_stated(
    small_take: SmallTake, refusal: Refusal
) -> None:
    folder = small_take(source="silhouettes")
    (folder / "silhouettes/cam02/000002.png").unlink()
    _leave_frames_to_the_files(folder)
    assert refusal(folder) == (
        "silhouettes/cam02/000002.png: is missing: expected a silhouette for each frame up to that of "
        "000003.png"
    )


def test_an_empty_clean_plate_picture(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(clean_plate="picture")
    _empty(folder / "background/cam01.png")
    assert refusal(folder) == "background/cam01.png: is empty (0 bytes): export it again"


@pytest.mark.parametrize(
    ("unsure", "expected"),
    [
        (None, [BACKGROUND, BACKGROUND, BACKGROUND, UNSURE, ACTOR, ACTOR]),
        ([64, 191], [BACKGROUND, BACKGROUND, UNSURE, UNSURE, UNSURE, ACTOR]),
        ([1, 254], [BACKGROUND, UNSURE, UNSURE, UNSURE, UNSURE, ACTOR]),
        ([], [BACKGROUND, BACKGROUND, BACKGROUND, ACTOR, ACTOR, ACTOR]),
    ],
)
def test_greys_of_a_matte(small_take: SmallTake, unsure: list[int] | None, expected: list[int]) -> None:
    folder = small_take(source="silhouettes", **({} if unsure is None else {"unsure": unsure}))
    matte = np.zeros((48, 64), np.uint8)
    matte[10:16] = np.array([0, 63, 127, 128, 191, 255], np.uint8)[:, None]
    write_picture(folder / "silhouettes/cam02/000001.png", matte)
    take = open_take(folder)
    (trimap,) = take.trimaps(take.cameras[1], 1, 2)
    assert trimap[10:16, 7].tolist() == expected
    assert not trimap[:10].any()


@pytest.mark.parametrize("unsure", [[0, 9], [200, 100], [5], [9, 255]])
def test_greys_that_cannot_mean_unsure(small_take: SmallTake, refusal: Refusal, unsure: list[int]) -> None:
    folder = small_take(source="silhouettes")
    settings = folder / "take.toml"
    settings.write_text(f"unsure = {unsure}\n" + settings.read_text())
    assert refusal(folder) == (
        "take.toml: unsure: expected two greys from 1 to 254, the lower one first, such as [64, 191], or [] "
        f"if none means unsure, found {unsure}"
    )


def test_folders_of_other_names_and_a_missing_take_file_are_told(
    small_take: SmallTake, refusal: Refusal
) -> None:
    folder = small_take()
    shutil.rmtree(folder / "videos")
    for name in ("one", "two"):
        (folder / "silhouettes" / name).mkdir(parents=True)
    said = refusal(folder)
    assert "the folders there are: one, two: name them like the cameras, or leave [cam01] out" in said
    (folder / "take.toml").unlink()
    assert "expected a text file with the lines name" in refusal(folder)
