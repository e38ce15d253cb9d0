"""`xormocap`: its sub-commands."""

from importlib import import_module
from importlib.metadata import version

import typer
from typer.main import get_command
from typer.testing import CliRunner

from services.cli import _MODULES, app


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
