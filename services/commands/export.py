"""`xormocap export`: files of a result, made later from its poses.csv and actor.toml."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from services.commands.consoles import say
from services.mocap.body.humanoid_names import Naming
from services.mocap.errors import UserError, in_short, nearest
from services.mocap.export.formats import DEFAULT_FORMATS, FORMATS, FormatName, Options, write_formats
from services.mocap.motion.rest import Rest
from services.mocap.result.result import load_result

_DEFAULT = Options()


def export(
    result: Annotated[Path, typer.Argument(help="A folder of results.", metavar="RESULT")],
    to: Annotated[
        list[str] | None,
        typer.Option(
            metavar="|".join(FORMATS), help="What to write; may be repeated; by default what a run writes."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The folder for the files; RESULT by default.", metavar="FOLDER")
    ] = None,
    naming: Annotated[Naming, typer.Option(help="What bvh calls joints.")] = _DEFAULT.naming,
    unit: Annotated[Literal["m", "cm"], typer.Option(help="The unit of bvh's lengths.")] = _DEFAULT.unit,
    rest: Annotated[Rest, typer.Option(help="The rest pose of bvh.")] = _DEFAULT.rest,
    take: Annotated[
        Path | None, typer.Option(help="The take, for overlay; the one that was tracked by default.")
    ] = None,
) -> None:
    """Write files of a result for other programs; poses.csv and actor.toml in it are enough."""
    folder = out or result
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file: expected a folder for the exported files")
    names = tuple(map(_format, dict.fromkeys(to or DEFAULT_FORMATS)))
    options = Options(naming=naming, unit=unit, rest=rest, take=take)
    for path in write_formats(folder, load_result(result), names, options):
        say(str(path))


def _format(name: str) -> FormatName:
    for known in FORMATS:
        if known == name:
            return known
    raise UserError(f"--to {in_short(name)}: unknown format: {nearest(name, FORMATS)}")
