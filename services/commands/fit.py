"""`xormocap fit`: the actor's shape and first poses."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from services.commands.consoles import stdout, warn
from services.commands.fit_show import fit_with_bar, show_fit, with_every_core
from services.commands.options import MeshOption, TakeFolder, imported
from services.mocap.errors import UserError
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import check_place, write_actor
from services.mocap.take.fit_record import FIT_FOLDER
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR
from services.options import (
    DEFAULT_ENGINE,
    DEFAULT_SEGMENTER,
    BackendOption,
    SegmenterOption,
    engine_settings,
)
from services.runs.fit import fit_take, init_frames
from services.runs.fit_files import origin_of
from services.runs.refine import DEFAULT_REFINE_FRAMES, refine_take


def fit(
    take: TakeFolder,
    out: Annotated[
        Path | None, typer.Option(help="Where actor.toml and pictures go; into the take by default.")
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(min=1, help="How many frames: the first, init_frames by default; to refine, 16 of all."),
    ] = None,
    refine: Annotated[
        Path | None,
        typer.Option(
            metavar="RESULT", help="Begin with what xormocap track found, and look at frames of all of it."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an actor.toml made by hand.")] = False,
    mesh: MeshOption = None,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
) -> None:
    """Fit the actor's shape and first poses to a take's first frames, and show how well that went."""
    if refine is not None and mesh is not None:
        raise UserError("--refine: takes the body of RESULT: leave out --mesh")
    opened = open_take(take)
    actor_toml = (out or take) / ACTOR
    check_place(actor_toml, force)
    folder = out or take / FIT_FOLDER
    warnings: list[str] = []
    if refine is not None:
        count = frames or DEFAULT_REFINE_FRAMES
        work = partial(refine_take, opened, refine, count, segmenter=segmenter)
    else:
        work = partial(
            fit_take,
            opened,
            init_frames(opened, frames),
            with_every_core(engine_settings(backend, DEFAULT_ENGINE.threads)),
            SearchSettings(),
            mesh=imported(mesh, warnings),
            segmenter=segmenter,
        )
    found = fit_with_bar(opened, folder, work)
    if out is None:
        write_actor(actor_toml, found.actor, origin_of(opened, found))
    warn([*warnings, *found.warnings])
    show_fit(found, opened, folder, stdout)
