"""A run in which the actor faces the other way than he does: it is noticed, and repeated."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from one_process import tracked_here

from services.commands import fitted_runs
from services.mocap.body.actor import build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import UserError
from services.mocap.result.layout import POSES, RUN_JSON, journal_of, partial_of
from services.mocap.result.result import load_result
from services.mocap.search.first_pose import turned_round
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import read_actor
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import ACTOR
from services.mocap.take.tables import write_poses_csv
from services.runs.refine import fit_other_way_round
from services.runs.take_silhouettes import TakeSilhouettes
from services.runs.track import TakeJob

_N_FRAMES = 4
_NEAR_M = 0.06


@pytest.fixture(scope="module")
def take(exact_take: Path) -> Take:
    return open_take(exact_take)


@pytest.fixture(scope="module")
def right(exact_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results that face the right way."""
    folder = tmp_path_factory.mktemp("right") / "result"
    return tracked_here(exact_take, folder, "14:20", SearchSettings(both_ways=False))


@pytest.fixture
def turned(right: Path, tmp_path: Path) -> Path:
    """The same, facing the other way."""
    folder = tmp_path / "result"
    shutil.copytree(right, folder)
    tracked = load_result(folder).tracked
    write_poses_csv(folder / POSES, replace(tracked, poses=np.array(list(map(turned_round, tracked.poses)))))
    return folder


def test_results_that_face_the_right_way_stay(take: Take, right: Path) -> None:
    assert fit_other_way_round(TakeSilhouettes(take), right, _N_FRAMES, SearchSettings()) is None


def test_others_are_fitted_the_right_way_round(take: Take, right: Path, turned: Path) -> None:
    found = fit_other_way_round(TakeSilhouettes(take), turned, _N_FRAMES, SearchSettings())
    assert found is not None
    result = load_result(right)
    rows = np.searchsorted(result.frames, found.frames)
    assert (found.frames[0], found.frames[-1], len(rows)) == (result.frames[0], result.frames[-1], _N_FRAMES)
    fitted_m = joint_positions(found.fit.poses, build_body(found.fit.actor).offsets_m)
    true_m = joint_positions(result.tracked.poses[rows], build_body(result.actor).offsets_m)
    assert np.linalg.norm(fitted_m - true_m, axis=-1).mean() < _NEAR_M
    assert not found.actor.colours


def test_the_run_is_repeated_forwards_with_that_fit(
    take: Take, right: Path, turned: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    jobs = list[TakeJob]()

    def tracked(job: TakeJob) -> dict[str, Any]:
        assert job.fitted is not None
        assert read_actor(job.fitted / ACTOR).height > 0
        jobs.append(job)
        return {"speed": {"fps": 2.0}}

    monkeypatch.setattr(fitted_runs, "track_with_bar", tracked)
    monkeypatch.setattr(fitted_runs, "_fitted_again", lambda _job, _silhouettes, report, **_: report)
    silhouettes, report = TakeSilhouettes(take), dict[str, Any]()
    job = TakeJob(
        out=right, workers=0, engine=EngineSettings(), search=SearchSettings(), take=take,
        frames=range(14, 20), overlay=False,
    )  # fmt: skip
    assert fitted_runs.track_again(job, silhouettes, report, is_asked_for=False) is report
    assert not jobs
    told = replace(take, settings=take.settings.model_copy(update={"facing": 90.0}))
    told_job = replace(job, out=turned, take=told, frames=range(6))
    fitted_runs.track_again(told_job, silhouettes, report, is_asked_for=False)
    assert not jobs, "take.toml says which way the actor faces"
    nobody = Mock(side_effect=UserError("nobody is visible"))
    with monkeypatch.context() as patched:
        patched.setattr(fitted_runs, "fit_other_way_round", nobody)
        assert fitted_runs.track_again(job, silhouettes, report, is_asked_for=False) is report
        assert nobody.call_count == 2
    job = replace(job, out=turned)
    assert fitted_runs.track_again(job, silhouettes, report, is_asked_for=False) == {"speed": {"fps": 2.0}}
    assert [one.search.both_ways for one in jobs] == [False, False], "before the second fit, and after it"
    assert "the actor faces the other way" in " ".join(capfd.readouterr().out.split())


def test_an_interrupted_second_run_repeats_the_first_one_only_if_the_take_has_changed(
    exact_take: Path, right: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, out = tmp_path / "walk", tmp_path / "out"
    shutil.copytree(exact_take, folder)
    shutil.copytree(right, out)
    partial_of(out).mkdir()
    journal_of(out).touch()
    search = SearchSettings(both_ways=False)
    run = json.loads((out / RUN_JSON).read_text()) | {"settings": {"search": search.model_dump(mode="json")}}
    (out / RUN_JSON).write_text(json.dumps(run))
    monkeypatch.setattr(fitted_runs, "track_with_bar", lambda *_: {"speed": {"fps": 2.0}})
    job = TakeJob(
        out=out, workers=0, engine=EngineSettings(), search=search, take=open_take(folder),
        frames=range(14, 20), overlay=False,
    )  # fmt: skip
    assert fitted_runs.track_given(job, is_first_run=True) == run
    picture = next((folder / "silhouettes").rglob("*.png"))
    later_ns = (out / RUN_JSON).stat().st_mtime_ns + 1_000_000_000
    os.utime(picture, ns=(later_ns, later_ns))
    assert fitted_runs.track_given(job, is_first_run=True) == {"speed": {"fps": 2.0}}
