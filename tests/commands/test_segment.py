"""`xormocap segment` says where the actor cannot be told from the background, and draws it."""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from services import cli
from services.mocap.types import ACTOR, UNSURE, Trimap
from services.segmentation.files import UnsureThirds, thirds_in_words
from services.segmentation.silhouettes import Moment

SmallTake = Callable[..., Path]


def _actor(unsure_rows: slice | None = None) -> Trimap:
    """Somebody 36 pixels high (48, 64), of whom some rows may be unsure."""
    trimap = np.zeros((48, 64), np.uint8)
    trimap[6:42, 20:32] = ACTOR
    if unsure_rows is not None:
        trimap[unsure_rows, 20:32] = UNSURE
    trimap[5:43:2, 50] = UNSURE  # specks
    return trimap


class _Given:
    """In place of a segmenter: the second camera loses the legs in some frames."""

    def __init__(self, unsure_frames: int) -> None:
        self._unsure_frames, self.source = unsure_frames, self

    def raw_moments(self, start: int, stop: int, **_: bool) -> Iterator[Moment]:
        for frame in range(start, stop):
            yield Moment([_actor(), _actor(slice(31, 42) if 0 < frame <= self._unsure_frames else None)])


@pytest.fixture
def segment(
    small_take: SmallTake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[int], tuple[str, Path]]:
    """`segment(unsure_frames)`: what is said of a take of four frames, and where its silhouettes are."""

    def run(unsure_frames: int) -> tuple[str, Path]:
        take, out = small_take(frames=4), tmp_path / "out"
        monkeypatch.setattr("services.segmentation.files.make_segmenter", lambda *_: _Given(unsure_frames))
        done = CliRunner().invoke(cli.app, ["segment", str(take), "--out", str(out)], catch_exceptions=False)
        return done.output, out

    return run


def test_the_third_and_the_camera_are_named_and_drawn(segment: Callable[[int], tuple[str, Path]]) -> None:
    said, out = segment(2)
    assert "silhouettes: the lower third of the actor in cam02 cannot be told from the background: " in said
    assert f"{out / 'unsure.png'} shows where" in said
    sheet = cv2.imread(str(out / "unsure.png")).astype(int)
    is_cyan = sheet[:, :, :2].min(axis=2) - sheet[:, :, 2] > 60
    rows = np.flatnonzero(is_cyan[24:].mean(axis=1) > 0.1)  # below the title
    assert 0.6 * sheet.shape[0] < 24 + rows.min() < 0.7 * sheet.shape[0]
    assert (out / "silhouettes" / "cam02" / "000003.png").exists()


def test_nothing_is_said_of_a_moment_or_where_all_is_sure(segment: Callable[[int], tuple[str, Path]]) -> None:
    said, out = segment(1)
    assert "cannot be told" not in said
    assert not (out / "unsure.png").exists()


def test_thirds_are_those_of_who_is_to_be_seen() -> None:
    upper, nobody, hidden = UnsureThirds(), UnsureThirds(), UnsureThirds()
    for frame in range(5):
        upper.add(frame, _actor(slice(6, 14) if frame in (2, 3) else None))
        nobody.add(frame, np.zeros((48, 64), np.uint8))
        hidden.add(frame, _actor(slice(6, 42)))
    assert (upper.frames, upper.worst_frame, nobody.frames) == (5, 2, 0)
    assert thirds_in_words(["cam01", "cam02"], [upper, nobody]).startswith(
        "silhouettes: the upper third of the actor in cam01 cannot be told from the background"
    )
    assert hidden.named == ["upper", "middle", "lower"]
    assert thirds_in_words(["cam01"], [nobody]) == ""
