"""`xormocap fit --refine` and `track --refine`: the body fitted again, where it has been tracked."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from busy import ONE_WAY, SHORT
from one_process import tracked_here

from few_starts import few_starts
from services.commands.fitted_runs import track_again
from services.commands.track import track
from services.mocap.body.actor import build_body
from services.mocap.body.bones import BONES
from services.mocap.body.measures import measure
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import UserError
from services.mocap.result.layout import CORRECTED_FRAMES, journal_of, partial_of
from services.mocap.result.result import load_result
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import read_actor, write_actor
from services.mocap.take.fit_record import FIT_FOLDER
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR
from services.mocap.take.tables import read_poses_csv
from services.runs import Interrupted
from services.runs.fit import fit_take, init_frames
from services.runs.fit_files import write_fit
from services.runs.take_fit import TakeFit
from services.runs.take_silhouettes import TakeSilhouettes
from services.runs.track import TakeJob
from services.runs.track import track as track_take

pytestmark = pytest.mark.usefixtures("no_report")
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


def _misplace_joints(folder: Path) -> dict[str, float]:
    """Change the actor of a folder so that its elbows and knees are not where the actor has them; the true
    lengths in centimetres are returned."""
    true_cm = _lengths_cm(folder)
    wrong_m = {bone: (true_cm[word] + 100 * off_m) / 100 for bone, word, off_m in _WRONG}
    actor = read_actor(folder / ACTOR).model_copy(update={"bone_lengths": wrong_m})
    write_actor(folder / ACTOR, actor, "nothing")
    return true_cm


@pytest.fixture
def result(tracked: Path, tmp_path: Path) -> Path:
    """Results of a body whose elbows and knees are not where the actor has them."""
    folder = tmp_path / "result"
    shutil.copytree(tracked, folder)
    _misplace_joints(folder)
    return folder


def test_joints_are_found_where_limbs_bend(exact_take: Path, xormocap: Command, tmp_path: Path) -> None:
    """All with exact silhouettes, since those of videos this small move an elbow by a centimetre."""
    out = tmp_path / "out"
    result = tracked_here(exact_take, tmp_path / "result", "14:20", SearchSettings(both_ways=False))
    first, *_, last = _trusted_frames(result)
    true_cm = _misplace_joints(result)
    done = xormocap("fit", exact_take, "--refine", result, "--frames", 6, "--out", out)
    assert done.returncode == 0, done.stderr
    found_cm = _lengths_cm(out)
    for _, word, off_m in _WRONG:
        assert found_cm[word] == pytest.approx(true_cm[word], abs=100 * abs(off_m) / 4), word
    frames = read_poses_csv(out / "poses.csv").frames
    assert len(frames) == 6
    assert frames[[0, -1]].tolist() == [first, last]
    assert f"6 frames from {first} to {last}" in done.stdout


def test_results_of_another_take_are_refused(
    known_take: Path, result: Path, refused: Callable[..., str]
) -> None:
    run_json = result / "run.json"
    run_json.write_text(run_json.read_text().replace('"name": "walk"', '"name": "another"'))
    said = refused("fit", known_take, "--refine", result)
    assert "is of 'another', not of 'walk'" in said


def test_results_with_more_frames_than_the_take_are_refused(
    known_take: Path, result: Path, refused: Callable[..., str], tmp_path: Path
) -> None:
    shorter = tmp_path / "shorter"
    shutil.copytree(known_take, shorter)
    settings = shorter / "take.toml"
    settings.write_text(re.sub(r"frames = \d+", "frames = 4", settings.read_text()))
    said = refused("fit", shorter, "--refine", result)
    assert re.search(r"has frame \d+, but .* only 4 frames: track it again", said)


def test_one_frame_is_too_few(known_take: Path, tracked: Path, refused: Callable[..., str]) -> None:
    said = refused("fit", known_take, "--refine", tracked, "--frames", 1, "--force")
    assert "--frames 1: expected at least 2 with --refine" in said


def test_a_take_is_tracked_fitted_again_and_tracked_once_more(
    exact_take: Path, xormocap: Command, tmp_path: Path
) -> None:
    take, out = tmp_path / "walk", tmp_path / "out"
    shutil.copytree(exact_take, take)
    true_cm = _misplace_joints(take)
    given_cm = _lengths_cm(take)
    some = ("--frames", "14:20", "--workers", 1, *SHORT)
    done = xormocap("track", take, "--refine", *some, "--out", out)
    assert done.returncode == 0, done.stderr
    assert _lengths_cm(take) == given_cm, "the take is left as it was"
    found_cm = _lengths_cm(out)
    for _, word, off_m in _WRONG:
        assert abs(found_cm[word] - true_cm[word]) < 100 * abs(off_m), word
    assert "fit" in json.loads((out / "run.json").read_text())
    assert len(read_poses_csv(out / "poses.csv").frames) == 6


def test_furniture_that_the_first_run_shows_is_unsure_in_the_second(
    exact_take: Path, xormocap: Command, tmp_path: Path
) -> None:
    """A table before the legs in one camera."""
    take, out = tmp_path / "walk", tmp_path / "out"
    shutil.copytree(exact_take, take)
    camera = open_take(take).cameras[0].name
    table = np.s_[130:200, 110:230]
    n_hidden_px = 0
    for path in sorted((take / "silhouettes" / camera).iterdir()):
        silhouette = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        n_hidden_px += np.count_nonzero(silhouette[table])
        silhouette[table] = 0
        cv2.imwrite(str(path), silhouette)
    assert n_hidden_px > 1000
    done = xormocap("track", take, "--refine", "--frames", "0:20", "--workers", 1, *SHORT, "--out", out)
    assert done.returncode == 0, done.stderr
    assert f"something hides the actor from {camera}" in " ".join(done.stderr.split())
    found = cv2.imread(str(out / "fit" / "occluded" / f"{camera}.png"), cv2.IMREAD_GRAYSCALE) > 0
    assert np.count_nonzero(found) > 300
    grown = np.zeros_like(found)
    grown[128:202, 108:232] = True
    assert not (found & ~grown).any()
    assert [path.stem for path in (out / "fit" / "occluded").iterdir()] == [camera]


@pytest.fixture(scope="module")
def strange_take(exact_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take without an actor, whose body is fitted to one frame: three suffice to fit it again."""
    take = tmp_path_factory.mktemp("unfitted") / "strange"
    shutil.copytree(exact_take, take)
    (take / ACTOR).unlink()
    settings = take / "take.toml"
    settings.write_text(re.sub(r"(?m)^init_frames = .*$", "init_frames = 1", settings.read_text()))
    assert open_take(take).settings.init_frames == 1
    return take


@pytest.fixture(scope="module")
def first_fit(strange_take: Path) -> TakeFit:
    """The body that is fitted to it."""
    take = open_take(strange_take)
    with few_starts():
        return fit_take(
            TakeSilhouettes(take), init_frames(take), EngineSettings(), SearchSettings(), lambda *_: None
        )


@pytest.mark.parametrize("is_stored", [False, True], ids=["for this run", "in the take"])
def test_a_body_that_was_fitted_to_first_frames_is_fitted_again_and_an_interrupted_second_run_goes_on(
    strange_take: Path,
    first_fit: TakeFit,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    is_stored: bool,
) -> None:
    """The second fit gives the same body again; the first run is not repeated."""
    out, jobs, runs = tmp_path / "out", list[TakeJob](), iter([track_take, _interrupted, track_take])

    def counted(job: TakeJob, **watched: Any) -> dict[str, Any]:
        jobs.append(job)
        return next(runs)(job, **watched)

    height_m, fitted_m = first_fit.actor.height, first_fit.actor.bone_lengths  # none where nothing was better
    usual_m = {bone: BONES[bone].length_heights * height_m for bone, _, _ in _WRONG}
    wrong_m = {bone: (usual_m | fitted_m)[bone] + off_m for bone, _, off_m in _WRONG}
    bones_m = first_fit.actor.bone_lengths | wrong_m
    badly = replace(first_fit, actor=first_fit.actor.model_copy(update={"bone_lengths": bones_m}))
    monkeypatch.setattr("services.commands.fitted_runs.track_take", counted)
    if is_stored:
        shutil.copytree(strange_take, strange_take := tmp_path / "walk")
        write_actor(strange_take / ACTOR, badly.actor, "its first frames")
        write_fit(open_take(strange_take), badly, strange_take / FIT_FOLDER)
    else:
        monkeypatch.setattr("services.commands.fitted_runs.fit_take", lambda *_, **__: badly)
    with pytest.raises(Interrupted):
        track(strange_take, out, workers=1, frames="0:3", check=False, overlay=False)
    first = read_actor(out / ACTOR)
    track(strange_take, out, workers=1, frames="0:3", check=False, overlay=False)
    assert [job.search.both_ways for job in jobs] == [False, True, True]
    assert read_actor(out / ACTOR) != first
    assert len(read_poses_csv(out / "fit" / "poses.csv").frames) == 3
    said = " ".join(capfd.readouterr().out.split())
    assert "the body was fitted again, to frames of the whole take; most changed: " in said
    assert f"xormocap fit {strange_take} --refine {out} stores this body in the take" in " ".join(
        said.split()
    )


def _interrupted(job: TakeJob, **_: Any) -> dict[str, Any]:
    partial_of(job.out).mkdir()
    journal_of(job.out).touch()
    raise Interrupted(partial_of(job.out))


def test_results_stay_where_no_second_fit_is_possible_or_better(
    strange_take: Path,
    first_fit: TakeFit,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("services.commands.fitted_runs.fit_take", lambda *_, **__: first_fit)
    nothing_to_trust = Mock(side_effect=UserError("expected at least 2 frames in which"))
    out = tmp_path / "out"
    monkeypatch.setattr("services.commands.fitted_runs.refine_take", nothing_to_trust)
    track(strange_take, out, workers=1, frames="0:3", changes=[ONE_WAY[1]], check=False)
    assert "was not fitted again to the whole take: expected at least 2 frames" in capfd.readouterr().err
    assert len(read_poses_csv(out / "poses.csv").frames) == 3
    assert (out / "overlay.mp4").exists()

    one_way = SearchSettings(both_ways=False)
    job = TakeJob(
        out=out, workers=0, engine=EngineSettings(), search=one_way, take=open_take(strange_take),
        frames=range(3), overlay=False,
    )  # fmt: skip
    report, known, silhouettes = {"speed": {}}, load_result(out), TakeSilhouettes(job.take)
    with pytest.raises(UserError, match="expected at least 2 frames in which"):
        track_again(job, silhouettes, report, is_asked_for=True)
    same = SimpleNamespace(actor=known.actor, warnings=[], moved_take=None)
    monkeypatch.setattr("services.commands.fitted_runs.fit_with_bar", lambda *_: same)
    assert track_again(job, silhouettes, report, is_asked_for=True) is report
    assert capfd.readouterr().out.endswith("left the body as it is\n")

    def tracked_both_ways(job: TakeJob) -> dict[str, Any]:
        assert job.search == SearchSettings()
        assert job.fitted is not None
        assert read_actor(job.fitted / ACTOR) == known.actor
        return {"speed": {"fps": 2.0}}

    monkeypatch.setattr("services.commands.fitted_runs.track_with_bar", tracked_both_ways)
    settled = track_again(replace(job, search=SearchSettings()), silhouettes, report, is_asked_for=True)
    assert settled == {"speed": {"fps": 2.0}}, "the first run went one way only"
    went_both_ways = report | {CORRECTED_FRAMES: {}}
    both_ways = replace(job, search=SearchSettings())
    assert track_again(both_ways, silhouettes, went_both_ways, is_asked_for=True) is went_both_ways
    coloured = known.actor.model_copy(update={"colours": {"head": (1, 1, 2, 2)}})
    with_colours = SimpleNamespace(actor=coloured, warnings=[], moved_take=None)
    monkeypatch.setattr("services.commands.fitted_runs.fit_with_bar", lambda *_: with_colours)
    monkeypatch.setattr("services.commands.fitted_runs.track_with_bar", lambda *_: {"speed": {"fps": 1.0}})
    assert track_again(job, silhouettes, report, is_asked_for=True) == {"speed": {"fps": 1.0}}
    assert "left the body as it is; the actor's colours were learnt" in capfd.readouterr().out
    write_actor(job.out / ACTOR, coloured, "")
    with_colours.actor = known.actor
    track_again(job, silhouettes, report, is_asked_for=True)
    assert "left the body as it is; the actor's colours cannot be told apart" in capfd.readouterr().out
    write_actor(job.out / ACTOR, known.actor, "")
    np.testing.assert_array_equal(load_result(out).poses, known.poses)
