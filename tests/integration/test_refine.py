"""`xormocap fit --refine` and `track --refine`: the body fitted again, where it has been tracked."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from services.commands.track import track
from services.mocap.body.actor import build_body
from services.mocap.body.measures import measure
from services.mocap.errors import UserError
from services.mocap.result.layout import journal_of, partial_of
from services.mocap.result.result import load_result
from services.mocap.take.actor_file import read_actor, write_actor
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR
from services.mocap.take.tables import read_poses_csv
from services.runs.local_run import Interrupted
from services.runs.track import TakeJob
from services.runs.track import track as track_take

Command = Callable[..., object]
_OFF_M = 0.02
_WRONG = (
    ("upper_arm", "upper arm", _OFF_M),
    ("forearm", "forearm", -_OFF_M),
    ("thigh", "thigh", _OFF_M),
    ("shank", "shank", -_OFF_M),
)
"""Bones, what their lengths are called among the measures, and how far they are off."""


def _lengths_cm(folder: Path) -> dict[str, float]:
    return {row.name: row.cm for row in measure(build_body(read_actor(folder / ACTOR)))}


def _trusted_frames(folder: Path) -> list[int]:
    found = load_result(folder)
    frames: list[int] = found.frames[~found.distrusted.any(axis=1)].tolist()
    return frames


@pytest.fixture
def result(tracked: Path, tmp_path: Path) -> Path:
    """Results of a body whose elbows and knees are not where the actor has them."""
    folder = tmp_path / "result"
    shutil.copytree(tracked, folder)
    true = _lengths_cm(tracked)
    wrong_m = {bone: (true[word] + 100 * off_m) / 100 for bone, word, off_m in _WRONG}
    actor = read_actor(tracked / ACTOR).model_copy(update={"bone_lengths": wrong_m})
    write_actor(folder / ACTOR, actor, "nothing")
    return folder


def test_joints_are_found_where_limbs_bend(
    synthetic_take: Path, tracked: Path, result: Path, xormocap: Command, tmp_path: Path
) -> None:
    """With exact silhouettes, since those of videos this small move an elbow by a centimetre."""
    take, out = tmp_path / "exact", tmp_path / "out"
    shutil.copytree(synthetic_take, take)
    (take / "reference" / "silhouettes").rename(take / "silhouettes")
    done = xormocap("fit", take, "--refine", result, "--frames", 4, "--out", out)
    assert done.returncode == 0, done.stderr
    true, found = _lengths_cm(tracked), _lengths_cm(out)
    for _, word, off_m in _WRONG:
        assert found[word] == pytest.approx(true[word], abs=100 * abs(off_m) / 4), word
    first, *_, last = _trusted_frames(tracked)
    frames = read_poses_csv(out / "poses.csv").frames
    assert len(frames) == 4
    assert frames[[0, -1]].tolist() == [first, last]
    assert f"4 frames from {first} to {last}" in done.stdout


def test_results_of_another_take_are_refused(known_take: Path, result: Path, xormocap: Command) -> None:
    run_json = result / "run.json"
    run_json.write_text(run_json.read_text().replace('"name": "walk"', '"name": "another"'))
    done = xormocap("fit", known_take, "--refine", result)
    assert done.returncode == 2
    assert "is of 'another', not of 'walk'" in " ".join(done.stderr.split())


def test_one_frame_is_too_few(known_take: Path, tracked: Path, xormocap: Command) -> None:
    done = xormocap("fit", known_take, "--refine", tracked, "--frames", 1, "--force")
    assert done.returncode == 2
    assert "--frames 1: expected at least 2 with --refine" in " ".join(done.stderr.split())


def test_a_take_is_tracked_fitted_again_and_tracked_once_more(
    synthetic_take: Path, xormocap: Command, tmp_path: Path
) -> None:
    take, out = tmp_path / "walk", tmp_path / "out"
    shutil.copytree(synthetic_take, take)
    true_cm = _lengths_cm(take)
    bones_m = {bone: (true_cm[word] + 100 * off_m) / 100 for bone, word, off_m in _WRONG}
    write_actor(
        take / ACTOR, read_actor(take / ACTOR).model_copy(update={"bone_lengths": bones_m}), "nothing"
    )
    given_cm = _lengths_cm(take)
    done = xormocap("track", take, "--refine", "--frames", "14:20", "--no-overlay", "--out", out)
    assert done.returncode == 0, done.stderr
    assert _lengths_cm(take) == given_cm, "the take is left as it was"
    found_cm = _lengths_cm(out)
    for _, word, off_m in _WRONG:
        assert abs(found_cm[word] - true_cm[word]) < 100 * abs(off_m), word
    assert "fit" in json.loads((out / "run.json").read_text())
    assert len(read_poses_csv(out / "poses.csv").frames) == 6


@pytest.fixture
def strange_take(known_take: Path, tmp_path: Path) -> Path:
    """A take without an actor, whose body is fitted to its first two frames."""
    take = tmp_path / "strange"
    shutil.copytree(known_take, take)
    (take / ACTOR).unlink()
    settings = take / "take.toml"
    settings.write_text(re.sub(r"(?m)^init_frames = .*$", "init_frames = 2", settings.read_text()))
    assert open_take(take).settings.init_frames == 2
    return take


def test_a_body_that_was_fitted_for_a_long_run_is_fitted_again(
    strange_take: Path, xormocap: Command, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = xormocap("track", strange_take, "--frames", "0:6", "--no-overlay", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "the body was fitted again, to frames of the whole take; most changed: " in done.stdout
    assert len(read_poses_csv(out / "fit" / "poses.csv").frames) == len(_trusted_frames(out)) == 6


def test_results_that_allow_no_second_fit_stay(
    strange_take: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def nothing_to_trust(*_: object, **__: object) -> None:
        raise UserError("expected at least 2 frames without a mark")

    monkeypatch.setattr("services.commands.fitted_runs.refine_take", nothing_to_trust)
    out = tmp_path / "out"
    track(strange_take, out, frames="0:6")
    assert "was not fitted again to the whole take: expected at least 2 frames" in capfd.readouterr().err
    assert len(read_poses_csv(out / "poses.csv").frames) == 6
    assert (out / "overlay.mp4").exists()
    with pytest.raises(UserError, match="expected at least 2 frames without a mark"):
        track(strange_take, tmp_path / "asked", frames="0:2", fitted=out / "fit", refine=True)


def test_a_second_run_that_was_interrupted_goes_on_without_the_first(
    strange_take: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It fits the body twice, which gives the same bodies, and then tracks as its journal says."""
    out, jobs, runs = tmp_path / "out", list[TakeJob](), iter([track_take, _interrupted, track_take])

    def counted(job: TakeJob, **watched: Any) -> dict[str, Any]:
        jobs.append(job)
        return next(runs)(job, **watched)

    monkeypatch.setattr("services.commands.fitted_runs.track_take", counted)
    with pytest.raises(Interrupted):
        track(strange_take, out, frames="0:6", overlay=False)
    first = read_actor(out / ACTOR)
    track(strange_take, out, frames="0:6", overlay=False)
    assert len(jobs) == 3
    assert read_actor(out / ACTOR) != first
    assert len(read_poses_csv(out / "fit" / "poses.csv").frames) == 6


def _interrupted(job: TakeJob, **_: Any) -> dict[str, Any]:
    partial_of(job.out).mkdir()
    journal_of(job.out).touch()
    raise Interrupted(partial_of(job.out))
