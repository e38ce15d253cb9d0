"""What `xormocap fit` does, with the fitting itself replaced: what it writes, keeps and says."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from typer.testing import CliRunner

from replaced_fit import FILES, fit_by, stretch, write_walk
from services import cli
from services.commands import fit as fit_command
from services.mocap.body.shape_space import vector_of
from services.mocap.body.skeleton import BodyName
from services.mocap.result.words import ENERGY_IN_WORDS, IOU_IN_WORDS
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import take_actor, write_actor
from services.mocap.take.folder import open_take
from services.runs.fit import init_frames
from services.runs.fit_files import write_fit
from services.runs.take_fit import TakeFit, concluded


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_walk(tmp_path_factory.mktemp("fit") / "walk")


@pytest.fixture(scope="module")
def found(folder: Path) -> TakeFit:
    take = open_take(folder)
    return fit_by(stretch, take, init_frames(take))


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, found: TakeFit) -> Callable[..., str]:
    """`command(*arguments)`: what the command prints; the fit is the one that is there already."""
    monkeypatch.setattr(fit_command, "fit_take", lambda *_, **__: found)

    def run(*arguments: object) -> str:
        done = CliRunner().invoke(cli.app, ["fit", *map(str, arguments)], catch_exceptions=True)
        return str(done.exception) if done.exception else done.output

    return run


def test_the_command_writes_into_the_take(folder: Path, found: TakeFit, command: Callable[..., str]) -> None:
    said = command(folder)
    assert take_actor(open_take(folder)) == found.actor
    assert {path.name for path in (folder / "fit").iterdir()} == FILES
    for word in ("height", "arm span", "chest girth", "IoU, cam01", "IoU, all cameras", "overlay.png"):
        assert word in said
    assert said.index("IoU, all cameras") < said.index(ENERGY_IN_WORDS) < said.index(IOU_IN_WORDS)
    assert "was made or changed by hand" not in command(folder)


@pytest.mark.parametrize(("iou", "is_poor"), [(0.80, True), (0.85, False)])
def test_a_poor_fit_is_said_and_its_measures_have_no_deviation(
    folder: Path, found: TakeFit, capsys: pytest.CaptureFixture[str], iou: float, is_poor: bool
) -> None:
    after = replace(found.fit.after, iou=np.full_like(found.fit.after.iou, iou))
    covariance = 1e-4 * np.eye(len(vector_of(found.actor)))
    fit = replace(found.fit, after=after, shape_covariance=covariance)
    again = concluded(found.frames, found.cameras, found.seen, (found.start, found.start_pose), fit, {}, [])
    assert all((row.uncertainty_cm is None) is is_poor for row in again.measures)
    fit_command.show_fit(again, open_take(folder), folder)
    assert ("body and silhouettes overlap less than usual (0.80)" in capsys.readouterr().out) is is_poor


@pytest.mark.parametrize("body", get_args(BodyName))
def test_the_body_of_the_option_is_fitted(
    folder: Path, found: TakeFit, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, body: BodyName
) -> None:
    fitted: list[object] = []

    def note(*arguments: object, **options: object) -> TakeFit:
        searches = (argument.body for argument in arguments if isinstance(argument, SearchSettings))
        fitted.append(options.get("body", next(searches, None)))
        return found

    for name in ("fit_take", "refine_take"):
        monkeypatch.setattr(fit_command, name, note)
    for refine in ((), ("--refine", str(folder))):
        words = ["fit", str(folder), "--out", str(tmp_path / "out"), "--body", body, *refine]
        assert CliRunner().invoke(cli.app, words).exit_code == 0
    assert fitted == [body, body]


def test_the_command_keeps_what_a_person_wrote(folder: Path, command: Callable[..., str]) -> None:
    mine = "height = 1.78\n"
    (folder / "actor.toml").write_text(mine)
    assert "was made or changed by hand" in command(folder)
    assert (folder / "actor.toml").read_text() == mine
    command(folder, "--force")
    assert (folder / "actor.toml").read_text() != mine


def test_the_command_keeps_a_body_that_was_fitted_to_the_whole_take(
    folder: Path, found: TakeFit, command: Callable[..., str], tmp_path: Path
) -> None:
    refined = replace(found, frames=tuple(found.frames))
    write_fit(open_take(folder), refined, folder / "fit")
    write_actor(folder / "actor.toml", refined.actor, "frames of the whole take")
    before = (folder / "actor.toml").read_text()
    assert "was fitted to frames of the whole take" in command(folder)
    assert (folder / "actor.toml").read_text() == before
    assert "IoU, all cameras" in command(folder, "--out", tmp_path / "out")
    assert "IoU, all cameras" in command(folder, "--force")
    assert (folder / "actor.toml").read_text() != before
    assert "IoU, all cameras" in command(folder), "that was a fit to the first frames"


def test_out_leaves_the_take_alone(folder: Path, command: Callable[..., str], tmp_path: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    command(folder, "--out", tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
