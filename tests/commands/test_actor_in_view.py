"""Where in a take the actor is in view for the first time."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Never

import numpy as np
import pytest
from typer.testing import CliRunner

from exact_take import write_exact_take
from services import cli
from services.commands import actor_in_view
from services.commands.actor_in_view import in_view
from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.take.folder import Take, open_take
from services.mocap.types import ACTOR, BACKGROUND, Trimap
from services.runs import take_silhouettes
from services.runs.fit import init_frames
from services.runs.take_silhouettes import TakeSilhouettes
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import Moment, Segmenter

Change = Callable[[Trimap], Trimap]
Show = Callable[..., None]
CHANGED_BEFORE = 11


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Take:
    folder = tmp_path_factory.mktemp("view") / "walk"
    write_exact_take(folder, n_frames=34, n_cameras=3)
    return open_take(folder)


@pytest.fixture
def changed(monkeypatch: pytest.MonkeyPatch) -> Show:
    """`changed(how)`: the silhouettes of frames before CHANGED_BEFORE are what `how` makes of them, and those
    of the last camera before another frame."""

    def show(how: Change, last_before: int = CHANGED_BEFORE) -> None:
        def segmenter(take: Take, cameras: Sequence[Camera], name: str, *options: Any) -> Segmenter:
            real = make_segmenter(take, cameras, name, *options)
            made = real.moments

            def moments(start: int, stop: int, **options: bool) -> Iterator[Moment]:
                for frame, moment in enumerate(made(start, stop, **options), start):
                    ends = [*[CHANGED_BEFORE] * (len(cameras) - 1), last_before]
                    trimaps = [
                        how(t) if frame < end else t for t, end in zip(moment.trimaps, ends, strict=True)
                    ]
                    yield replace(moment, trimaps=trimaps)

            monkeypatch.setattr(real, "moments", moments)
            return real

        monkeypatch.setattr(take_silhouettes, "make_segmenter", segmenter)

    return show


def _nobody(trimap: Trimap) -> Trimap:
    return np.full_like(trimap, BACKGROUND)


def _cut_off(trimap: Trimap) -> Trimap:
    """The lower half of the actor is below the picture."""
    rows = np.flatnonzero((trimap == ACTOR).any(axis=1))
    moved, down_px = _nobody(trimap), len(trimap) - (rows[0] + rows[-1]) // 2
    moved[down_px:] = trimap[:-down_px]
    return moved


def test_an_actor_who_is_there_is_seen_at_once(take: Take) -> None:
    assert in_view(TakeSilhouettes(take), range(24)) == range(24)
    assert in_view(TakeSilhouettes(take), range(3, 9)) == range(3, 9)


@pytest.mark.parametrize("how", [_nobody, _cut_off])
def test_the_work_begins_where_the_whole_actor_is_in_view(
    take: Take, changed: Show, how: Change, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(how)
    assert in_view(TakeSilhouettes(take), range(34)) == range(20, 34)
    assert in_view(TakeSilhouettes(take), range(2, 24)) == range(12, 24)
    assert in_view(TakeSilhouettes(take), range(9)) == range(9), "nobody comes"
    begun = in_view(TakeSilhouettes(take), range(34))
    assert init_frames(take, 3, begun.start) == range(20, 23)
    assert "frame 0 does not show the whole actor: the work begins at frame 20" in capsys.readouterr().err


def test_the_commands_begin_there_and_fit_the_body_to_the_first_frames_that_they_track(
    take: Take, changed: Show, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    given: list[tuple[range, object]] = []

    def fit_take(_: Take, frames: range, *__: object, **options: object) -> Never:
        given.append((frames, options.get("before")))
        raise UserError("enough")

    monkeypatch.setattr("services.commands.fit.fit_take", fit_take)
    monkeypatch.setattr("services.commands.fitted_runs.fit_take", fit_take)

    def run(command: str, *options: object) -> tuple[range, object]:
        arguments = [command, take.folder, "--out", tmp_path / "out", *options]
        CliRunner().invoke(cli.app, list(map(str, arguments)))
        return given.pop()

    assert take.settings.init_frames == 10
    assert run("track", "--frames", "3:9") == (range(3, 13), 9)
    changed(_nobody)
    assert run("track") == (range(20, 30), 34)
    assert run("track", "--no-check") == (range(5), 34), "a second fit follows"
    assert run("fit", "--frames", 4) == (range(20, 24), None)
    assert run("fit", "--frames", 4, "--no-check") == (range(4), None)


def test_the_actor_is_found_between_two_looks_that_are_far_apart(
    take: Take, changed: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(actor_in_view, "_EVERY", 1)
    monkeypatch.setattr(actor_in_view, "_MOST_LOOKS", 2)
    changed(_nobody)
    assert in_view(TakeSilhouettes(take), range(34)) == range(CHANGED_BEFORE, 34)


def test_a_frame_that_every_camera_sees_is_preferred(take: Take, changed: Show) -> None:
    changed(_nobody, last_before=25)
    assert in_view(TakeSilhouettes(take), range(34)) == range(30, 34)
    changed(_nobody, last_before=34)
    assert in_view(TakeSilhouettes(take), range(34)) == range(20, 34), "it never sees anybody"


def test_what_other_faults_the_first_frame_has_is_left_to_others(take: Take, changed: Show) -> None:
    changed(lambda trimap: np.full_like(trimap, ACTOR))
    assert in_view(TakeSilhouettes(take), range(24)) == range(24)
