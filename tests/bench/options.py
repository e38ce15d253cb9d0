"""Options that several measurements share, and the takes that they name."""

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from bench.studio_takes import Studio, names_between
from services.mocap.energy.detail.cache import cache_folder
from services.mocap.errors import UserError

NamedTake: TypeAlias = tuple[str, Callable[[], Path]]
"""A take's name, and what finds its folder or makes it."""


def writable(path: Path | None) -> Path | None:
    """Minutes of measuring are not to end at a file that cannot be written."""
    if path is not None and not path.parent.is_dir():
        raise typer.BadParameter(f"{path.parent} is not a folder: make it first")
    if path is not None and (path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK)):
        raise typer.BadParameter(f"{path} cannot be written: name another file")
    return path


def _seeds(text: str) -> str:
    try:
        names_between(text)
    except UserError as error:
        raise typer.BadParameter(str(error)) from None
    return text


JsonOption: TypeAlias = Annotated[
    Path | None, typer.Option("--json", callback=writable, help="Write the figures here as well.")
]
TakesArgument: TypeAlias = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[TAKE]...",
        help="Take folders, or basic, dance, walk: made once and kept; by default basic and dance.",
    ),
]
FramesOption: TypeAlias = Annotated[
    str, typer.Option(help="Range of frames A:B, from A up to but not including B.")
]
WorkersOption: TypeAlias = Annotated[
    int, typer.Option(min=0, max=64, help="Number of limb worker processes.")
]
TrackOption: TypeAlias = Annotated[
    str, typer.Option("--track", help="Further options of xormocap track, such as '--set max_passes=5'.")
]
StudioOption: TypeAlias = Annotated[
    Path | None,
    typer.Option("--studio", help="A folder with make_take.py, which makes the takes of --seeds."),
]
SeedsOption: TypeAlias = Annotated[
    str,
    typer.Option(
        "--seeds",
        callback=_seeds,
        help="The first and the last take that the studio makes: dev-100:dev-124.",
    ),
]
KeptOption: TypeAlias = Annotated[
    Path | None,
    typer.Option("--takes", help="Where the studio's takes are kept; in the cache by default."),
]


def studio_takes(studio: Path | None, seeds: str, kept: Path | None, *, with_videos: bool) -> list[NamedTake]:
    """The takes that a studio makes of --seeds.

    with_videos: which it takes minutes to render; else silhouettes alone. The two kinds are kept in folders
    of their own. Raises typer.BadParameter for a studio without seeds, or seeds without a studio.
    """
    if (studio is None) != (not seeds):
        raise typer.BadParameter("expected --studio with --seeds")
    if studio is None:
        return []
    folder = "videos" if with_videos else "silhouettes"
    made = Studio(studio, (kept or cache_folder() / "studio") / folder, with_videos)
    return [(name, partial(made.take, name)) for name in names_between(seeds)]


def given_takes(takes: Sequence[Path] | None) -> list[NamedTake]:
    """Takes that exist, by the names of their folders."""
    return [(take.resolve().name, partial(Path, take)) for take in takes or ()]
