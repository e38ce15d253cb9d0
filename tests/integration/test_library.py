"""Tracking from Python, in one process: the very poses of the services."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from few_starts import few_starts
from services import library
from services.library import (
    OutputSettings,
    SearchSettings,
    fit,
    open_take,
    refine,
    take_actor,
    track,
    write_result,
)
from services.mocap.body.actor import build_body
from services.mocap.errors import UserError
from services.mocap.result.result import load_result
from services.mocap.take.folder import Take
from services.mocap.take.tables import read_joints_csv, reference_joints
from services.runs.take_fit import TakeFit

_ONE_WAY = SearchSettings(both_ways=False)
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def take(synthetic_take: Path) -> Take:
    return open_take(synthetic_take)


@pytest.fixture(scope="module")
def fitted(take: Take) -> TakeFit:
    """The actor, fitted to two frames."""
    settings = take.settings.model_copy(update={"init_frames": 2})
    with few_starts():
        return fit(replace(take, settings=settings))


def test_one_process_finds_and_writes_what_the_services_do(tracked: Path, take: Take, tmp_path: Path) -> None:
    actor = take_actor(take)
    assert actor is not None
    frames = track(take, actor, range(14, 20), search=SearchSettings(search_limbs="always"))
    result = write_result(tmp_path / "result", take, actor, frames, formats=("bvh", "trc"))
    for name in ("poses.csv", "poses_smooth.csv", "joints.csv", "actor.toml", "motion.bvh", "motion.trc"):
        assert (tmp_path / "result" / name).read_bytes() == (tracked / name).read_bytes(), name
    assert result.frames.tolist() == list(range(14, 20))
    assert (result.fps, result.motion.name, result.take_folder) == (take.settings.fps, "walk", take.folder)


def test_a_result_is_replaced_as_a_whole(take: Take, tmp_path: Path) -> None:
    actor = take_actor(take)
    assert actor is not None
    frames = list(track(take, actor, range(14, 17), search=_ONE_WAY))
    write_result(tmp_path / "result", take, actor, frames)
    assert (tmp_path / "result" / "report.html").exists()
    write_result(tmp_path / "result", take, actor, frames[1:], ("bvh",), OutputSettings(smooth="none"))
    names = {path.name for path in (tmp_path / "result").iterdir()}
    assert names == {"poses.csv", "joints.csv", "actor.toml", "run.json", "motion.bvh"}
    for nothing in ([], [frames[0], frames[2]]):
        with pytest.raises(UserError, match="expected consecutive frames"):
            write_result(tmp_path / "result", take, actor, nothing)
    assert load_result(tmp_path / "result").frames.tolist() == [15, 16]


def test_the_readmes_example(
    take: Take,
    fitted: TakeFit,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It tracks the first frames of a take, whose actor has been fitted."""
    monkeypatch.setattr(library, "fit", lambda asked: fitted if asked.folder.samefile(take.folder) else None)
    (example,) = re.findall(
        r"^## From Python\n\n```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.M | re.S
    )
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my-take").symlink_to(take.folder)
    exec(example.replace("track(take, fitted)", "track(take, fitted, range(3))"))  # noqa: S102
    assert load_result(Path("my-result")).frames.tolist() == [0, 1, 2]
    assert capsys.readouterr().out.startswith("0 [")


def test_a_fit_knows_the_first_pose(take: Take, fitted: TakeFit) -> None:
    found = next(track(take, fitted, range(1, 2), search=_ONE_WAY)).solution
    told = next(track(take, fitted.actor, range(1, 2), fitted.fit.poses[1], search=_ONE_WAY)).solution
    np.testing.assert_array_equal(found.pose, told.pose)
    with few_starts():
        searched = next(track(take, fitted.actor, range(1, 2), search=_ONE_WAY)).solution
    assert found.evaluations < searched.evaluations


def test_an_actor_is_fitted_again_where_it_was_tracked(take: Take, tracked: Path) -> None:
    found = refine(take, tracked, n_frames=3)
    assert found.frames == (14, 16, 19)
    assert found.actor.height == pytest.approx(take.settings.actor_height, rel=0.01)
    reference = read_joints_csv(take.folder / "reference" / "joints.csv").joints_take_m
    joints_take_m = reference_joints(found.fit.poses, build_body(found.actor).offsets_m)
    off_mm = 1000.0 * np.linalg.norm(joints_take_m - reference[list(found.frames)], axis=2)
    assert off_mm.mean() < 15.0
    energies_px = [quality.energy_px.sum() for quality in (found.fit.before, found.fit.after)]
    assert energies_px[1] < 1.01 * energies_px[0]  # the run had the very body
    with pytest.raises(UserError, match="expected at least 2 with --refine"):
        refine(take, tracked, n_frames=1)


def test_what_does_not_suit_the_take_is_refused_at_once(take: Take) -> None:
    actor = take_actor(take)
    assert actor is not None
    with pytest.raises(UserError, match=r"20, 30.*0:24"):
        track(take, actor, range(20, 30))
    with pytest.raises(UserError, match="camera_weights: expected 5 numbers"):
        track(take, actor, search=SearchSettings(camera_weights=(1.0, 2.0)))
