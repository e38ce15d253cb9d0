"""`xormocap export`: writes files of a result from its poses.csv and actor.toml."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from services.commands.consoles import say
from services.mocap.body.humanoid_names import Naming
from services.mocap.errors import UserError, in_short, nearest
from services.mocap.export.formats import DEFAULT_FORMATS, FORMATS, FormatName, Options, write_formats
from services.mocap.motion.motion import Rest
from services.mocap.result.result import load_result

_DEFAULT = Options()


def export(
    result: Annotated[Path, typer.Argument(help="A results folder.", metavar="RESULT")],
    to: Annotated[
        list[str] | None,
        typer.Option(
            metavar="|".join(FORMATS),
            help="Formats to write, separated by commas; may be repeated; by default the files of a run.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The folder for the files; RESULT by default.", metavar="FOLDER")
    ] = None,
    naming: Annotated[Naming, typer.Option(help="Names of the joints in bvh.")] = _DEFAULT.naming,
    unit: Annotated[Literal["m", "cm"], typer.Option(help="Unit of length in bvh.")] = _DEFAULT.unit,
    rest: Annotated[Rest, typer.Option(help="Rest pose of bvh.")] = _DEFAULT.rest,
    take: Annotated[
        Path | None, typer.Option(help="The take, for overlay; by default the one that was tracked.")
    ] = None,
) -> None:
    """Write a result in other formats; needs only its poses.csv and actor.toml."""
    folder = out or result
    if folder.exists() and not folder.is_dir():
        expected = "a folder of results" if out is None else "a folder to write to"
        raise UserError(f"{folder}: is a file: expected {expected}")
    asked = [name.strip() for names in to for name in names.split(",")] if to else DEFAULT_FORMATS
    formats = tuple(map(_format, dict.fromkeys(asked)))
    options = Options(naming=naming, unit=unit, rest=rest, take=take)
    for path in write_formats(folder, load_result(result), formats, options):
        say(str(path))


def _format(name: str) -> FormatName:
    for known in FORMATS:
        if known == name:
            return known
    raise UserError(f"--to {in_short(name)}: unknown format: {nearest(name, FORMATS)}")
