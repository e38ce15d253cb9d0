"""Every command in the README pages exists with its options, and works as it stands there."""

import shlex
import subprocess
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner

from documented import (
    PAGES,
    ROOT,
    Command,
    blocks,
    commands_in_blocks,
    commands_in_text,
    options_in_text,
    simple_commands,
)
from home_recording import SQUARE_M, record
from services import cli
from services.mocap.camera.calibration import read_calibration
from services.mocap.camera.camera import Camera
from services.mocap.take.folder import open_take

_SCRIPTS = {
    "bench": "bench.__main__",
    "soak": "bench.soak.__main__",
    "check-results": "bench.checks.__main__",
}
"""Scripts that have a command line of their own -> its module; the others take at most a word."""
_OF_OTHERS = {"--detach", "--dev", "--device", "--gpus", "--help", "--scale"}
"""Options of Docker, of scripts/setup, and of every command."""
_FROM_NOTHING = ROOT / "services/segmentation/README.md"
_RUN_HERE = tuple(
    tuple(words.split())
    for words in (
        *("xormocap calibrate", "xormocap new", "xormocap sync", "xormocap play", "xormocap keys"),
        *("mkdir", "cp", "export", "openssl rand"),
    )
)
"""How commands begin that take little time."""
_ELSEWHERE = {
    "scripts/demo": "scripts/demo",
    "scripts/test": "scripts/test",
    "xormocap doctor": "tests/commands/test_doctor.py",
    "xormocap track": "tests/integration/test_track.py",
    "xormocap fit": "tests/integration/test_refine.py",
    "xormocap view": "tests/viewer/test_finished.py",
    "xormocap live": "tests/integration/test_live.py",
    "xormocap bridge": "tests/bridge/test_bridge.py",
    "python -m services": "tests/integration/test_services_by_hand.py",
    "docker compose": "tests/containers/test_compose.py",
    "kubectl": "tests/containers/test_files.py",
    "for": "tests/containers/test_files.py",
    "done": "tests/containers/test_files.py",
}
"""How the others begin, which take long or need more than this machine -> what runs the like of them."""
_IN_BLOCKS = [command for page in PAGES for command in commands_in_blocks(page)]
_IN_TEXT = [command for page in PAGES for command in commands_in_text(page)]


def _root_of(words: tuple[str, ...]) -> tuple[Any, tuple[str, ...]] | None:
    """The command line that words belong to, and its arguments; None for what is none of ours."""
    if words[0] == "xormocap":
        return get_command(cli.app), words[1:]
    if words[:2] == ("python", "-m"):
        return _alone(import_module(f"{words[2]}.__main__")), words[3:]
    script = Path(words[0])
    if script.parent.name == "scripts" and script.name in _SCRIPTS:
        module = import_module(_SCRIPTS[script.name])
        return get_command(module.app) if hasattr(module, "app") else _alone(module), words[1:]
    return None


def _alone(module: Any) -> Any:
    """The command line of a module that calls typer.run()."""
    app = typer.Typer(add_completion=False)
    app.command()(getattr(module, "main", None) or module.bridge)
    return get_command(app)


def _leaf_of(words: tuple[str, ...]) -> tuple[Any, list[str]] | None:
    """The sub-command that words name, and its arguments; raises a usage error if there is none."""
    found = _root_of(words)
    if found is None:
        return None
    command, arguments = found[0], list(found[1])
    while hasattr(command, "resolve_command") and arguments:
        _, command, arguments = command.resolve_command(typer.Context(command), arguments)
    return command, arguments


def _options_of(command: Any) -> set[str]:
    return {name for param in command.params for name in (*param.opts, *param.secondary_opts)}


def _check(words: tuple[str, ...]) -> None:
    """Raise a usage error unless the command line takes exactly these words; nothing is run."""
    leaf = _leaf_of(words)
    if leaf is not None:
        leaf[0].make_context(words[0], leaf[1])


def _all_commands(command: Any) -> Iterator[Any]:
    yield command
    if hasattr(command, "resolve_command"):
        context = typer.Context(command)
        for name in command.list_commands(context):
            yield from _all_commands(command.get_command(context, name))


@pytest.mark.parametrize("command", _IN_BLOCKS, ids=str)
def test_the_command_line_takes_it(command: Command) -> None:
    _check(command.words)


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("xormocap trakc my-take", "No such command"),
        ("xormocap track my-take --no-such", "No such option"),
        ("xormocap track my-take another", "unexpected extra argument"),
        ("xormocap new my-take", "Missing parameter: videos"),
        ("xormocap keys new", "Missing parameter: folder"),
        ("xormocap track my-take --workers many", "should be a valid integer"),
        ("python -m services.recorder --take t --out o --conect x", "No such option"),
        ("scripts/bench table9", "No such command"),
    ],
)
def test_a_wrong_one_would_be_found(line: str, problem: str) -> None:
    (words,) = simple_commands(line)
    with pytest.raises(Exception, match=problem):
        _check(words)


@pytest.mark.parametrize("command", _IN_TEXT, ids=str)
def test_what_sentences_name_exists(command: Command) -> None:
    """The sub-command and the options; a sentence may leave out arguments and values."""
    words = command.words
    if words[0].startswith(("scripts/", "./scripts/")):
        assert (ROOT / words[0]).is_file()
    assert all((ROOT / word).is_file() for word in words[1:] if word.endswith(".py"))
    leaf = _leaf_of(words)
    if leaf is not None:
        assert {word for word in leaf[1] if word.startswith("--")} <= _options_of(leaf[0]) | _OF_OTHERS


def test_options_that_sentences_name_are_somebodys() -> None:
    services = [
        f"python -m services.{name}" for name in ("coordinator", "recorder", "segmentation", "viewer")
    ]
    scripts = [f"scripts/{name}" for name in _SCRIPTS]
    roots = [_root_of(tuple(line.split())) for line in ("xormocap", *services, *scripts)]
    known = {
        name for root in roots if root for command in _all_commands(root[0]) for name in _options_of(command)
    }
    named = {name: page for page in PAGES for name in options_in_text(page)}
    unknown = {name: str(page) for name, page in named.items() if name not in known | _OF_OTHERS}
    assert not unknown


def test_files_that_docker_commands_name_are_there() -> None:
    named = [
        word
        for command in _IN_BLOCKS
        if command.words[0] in ("docker", "kubectl")
        for flag, word in zip(command.words, command.words[1:], strict=False)
        if flag in ("-f", "-k")
    ]
    assert len(named) >= 5
    assert [word for word in named if not (ROOT / word).exists()] == []


def _is_run_here(line: str) -> bool:
    return all(any(words[: len(first)] == first for first in _RUN_HERE) for words in simple_commands(line))


def _run(script: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Run those of a script's lines in a folder that are run here; returns them.

    `xormocap` runs in this process, because importing it takes seconds.
    """
    monkeypatch.chdir(folder)
    lines = [line for line in script.splitlines() if simple_commands(line) and _is_run_here(line)]
    for line in lines:
        words = shlex.split(line, comments=True)
        if words[0] == "xormocap":
            done = CliRunner().invoke(cli.app, words[1:], catch_exceptions=False)
            assert done.exit_code == 0, f"{line}\n{done.output}"
        else:
            subprocess.run(["bash", "-ec", line], check=True)
    return lines


@pytest.mark.parametrize("command", _IN_BLOCKS, ids=str)
def test_it_is_run_here_or_elsewhere(command: Command) -> None:
    here = any(command.words[: len(first)] == first for first in _RUN_HERE)
    line = " ".join(command.words).removeprefix("./")
    elsewhere = [where for first, where in _ELSEWHERE.items() if line.startswith(first)]
    assert here != bool(elsewhere)
    assert all((ROOT / where).is_file() for where in elsewhere)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[Camera, ...]]:
    """A folder with a newcomer's recordings, and the true cameras."""
    folder = tmp_path_factory.mktemp("home")
    return folder, record(folder)


def test_from_a_board_and_two_cameras_to_a_take(
    home: tuple[Path, tuple[Camera, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The blocks of the page that calibrates run in order in one folder."""
    folder, true = home
    ran = [line for script in blocks(_FROM_NOTHING) for line in _run(script, folder, monkeypatch)]
    assert [line.split()[1] for line in ran if line.startswith("xormocap")] == [
        *("calibrate", "calibrate", "new", "sync"),
        *("calibrate", "calibrate"),
    ]
    take = open_take(folder / "my-take")
    assert [camera.name for camera in take.cameras] == ["cam01", "cam02"]
    assert max(take.settings.offsets.values(), default=0) <= 1, "none if sync found them in step"
    assert all((folder / f"my-take/background/{camera.name}.mp4").is_file() for camera in take.cameras)
    for file, words in (("calibration.toml", ran[1]), ("my-take/calibration.toml", ran[-1])):
        square_m = float(words.split("--square ")[1].split()[0])
        for found, camera in zip(read_calibration(folder / file, "z"), true, strict=True):
            away_m = np.linalg.norm(found.centre_world_m) * SQUARE_M / square_m
            assert away_m == pytest.approx(np.linalg.norm(camera.centre_world_m), rel=0.02)


_OTHER_BLOCKS = [
    (page, script)
    for page in PAGES
    if page != _FROM_NOTHING
    for script in blocks(page)
    if any(simple_commands(line) and _is_run_here(line) for line in script.splitlines())
]


@pytest.mark.parametrize(("page", "script"), _OTHER_BLOCKS, ids=[b.split("\n")[0] for _, b in _OTHER_BLOCKS])
def test_the_other_blocks_run(
    page: Path, script: str, bare_result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my-result").symlink_to(bare_result)
    ran = _run(script, tmp_path, monkeypatch)
    assert ran, page
    if any("keys new" in line for line in ran):
        assert (tmp_path / "keys/coordinator").is_dir()
    if any(line.startswith("openssl") for line in ran):
        assert len((tmp_path / "keys/viewer/token").read_text()) > 36
