"""`xormocap`: its sub-commands."""

import re
import subprocess
import sys
import time
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner

from services.cli import _MODULES, app, main
from services.runs.launcher import free_endpoint


def test_the_help_names_every_sub_command_with_what_it_does() -> None:
    done = CliRunner().invoke(app, ["--help"], terminal_width=200, color=False)
    assert done.exit_code == 0
    lines = [line.strip("│ ") for line in done.output.splitlines()]
    told = [line.split(maxsplit=1) for line in lines if line.split(" ")[0] in _MODULES]
    assert [name for name, _ in told] == list(_MODULES)
    assert all(len(words) > 10 for _, words in told)


def test_each_is_what_its_module_has() -> None:
    context = typer.Context(get_command(app))
    for name, module in _MODULES.items():
        command = get_command(app).get_command(context, name)  # type: ignore[attr-defined]
        assert command.name == name
        assert hasattr(import_module(module), "app") or hasattr(import_module(module), name)


def test_the_version_is_that_of_the_package() -> None:
    done = CliRunner().invoke(app, ["--version"])
    assert (done.exit_code, done.output) == (0, f"xormocap {version('xormocap')}\n")


def test_the_help_of_track_is_short_and_help_all_has_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 80)
    done = [CliRunner().invoke(app, ["track", option], color=False) for option in ("--help", "--help-all")]
    assert [one.exit_code for one in done] == [0, 0]
    short, whole = (one.output for one in done)
    assert len(short.splitlines()) <= 45
    for option in ("--out", "--frames", "--view", "--strict", "--help-all"):
        assert option in short
    for option in ("--search", "--segmenter", "--endpoint", "--cutoff-hz"):
        assert option in whole and option not in short
    assert set(re.findall(r"--[a-z-]+", short)) <= set(re.findall(r"--[a-z-]+", whole))


@pytest.mark.parametrize(("flags", "is_told"), [((), False), (("-W", "default"), True)])
def test_warnings_of_libraries_are_told_only_on_demand(flags: tuple[str, ...], is_told: bool) -> None:
    code = (
        "import atexit, sys, warnings; from services import cli; sys.argv = ['xormocap', '--version']; "
        "atexit.register(lambda: warnings.warn('of a library', UserWarning)); cli.main()"
    )
    done = subprocess.run([sys.executable, *flags, "-c", code], capture_output=True, text=True, check=True)
    assert ("of a library" in done.stderr) is is_told


@pytest.mark.parametrize(("raised", "code"), [(KeyboardInterrupt(), 130), (SystemExit(143), 143)])
def test_a_signal_that_compiled_code_turns_into_an_error_ends_the_command_quietly(
    monkeypatch: pytest.MonkeyPatch, raised: BaseException, code: int
) -> None:
    """As Numba does where the signal comes while it makes the results of a compiled function."""

    def command() -> None:
        try:
            raise SystemError("unpickle returned a result with an exception set") from raised
        except SystemError as error:
            raise SystemError("follow returned a result with an exception set") from error

    monkeypatch.setattr("services.cli.app", command)
    monkeypatch.setattr("services.cli.signal.signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == code


def test_output_that_is_redirected_has_whole_lines() -> None:
    code = (
        "from services.commands.consoles import stdout, table_of; table = table_of('file', 'frames'); "
        "table.add_row('/a/long/path' * 20, '7'); stdout.print(table)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "/a/long/path" * 20 + "       7" in done.stdout


def test_status_without_a_run_answers_at_once() -> None:
    began_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "services.cli", "status", "--connect", free_endpoint()],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert "no run answers there: start one by xormocap track TAKE" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert time.monotonic() - began_s < 20, "seconds, on a busy machine"


@pytest.mark.parametrize("command", ["view", "export"])
def test_a_take_in_place_of_a_result_is_told_what_to_do(command: str, tmp_path: Path) -> None:
    (tmp_path / "take.toml").write_text("")
    done = subprocess.run(
        [sys.executable, "-m", "services.cli", command, str(tmp_path)], capture_output=True, text=True
    )
    expected = f"{tmp_path}: is a take without results: type xormocap track {tmp_path} first\n"
    assert (done.returncode, done.stderr) == (2, expected)
