import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest

from services.mocap.take.writer import write_picture

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


@pytest.mark.parametrize(
    ("spoil", "frame", "expected"),
    [
        (_empty, 2, "is empty (0 bytes): export it again"),
        (Path.unlink, 2, "is missing: expected a silhouette for each of the frames = 4 of take.toml"),
        (_cut, 3, "is damaged or cut off: export it again"),
        (_flip_a_bit, 1, "is damaged or cut off: export it again"),
        (_no_png, 1, "is not a PNG file: expected one of 64x48 pixels"),
        (_zeros_and_ones, 0, "its brightest grey is 1: expected 0 outside the actor, 255 inside"),
        (
            _other_size,
            2,
            "is 48x64 pixels, but [cam02] size in calibration.toml is 64x48: both have to be the same",
        ),
    ],
)
def test_a_bad_silhouette(
    small_take: SmallTake, refusal: Refusal, spoil: Callable[[Path], None], frame: int, expected: str
) -> None:
    folder = small_take(source="silhouettes")
    spoil(folder / f"silhouettes/cam02/00000{frame}.png")
    assert refusal(folder) == f"silhouettes/cam02/00000{frame}.png: {expected}"


def test_a_camera_without_silhouettes_among_others(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(source="silhouettes")
    shutil.rmtree(folder / "silhouettes/cam02")
    assert refusal(folder).startswith("silhouettes/cam02: is missing: expected the silhouettes of cam02")


def test_an_empty_clean_plate_picture(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(clean_plate="picture")
    _empty(folder / "background/cam01.png")
    assert refusal(folder) == "background/cam01.png: is empty (0 bytes): export it again"
