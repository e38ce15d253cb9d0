"""`xormocap fit`: the actor's shape and first poses."""

from pathlib import Path
from typing import Annotated

import typer

from services.commands.consoles import stderr, stdout, warn
from services.commands.fit_show import fit_with_bar, show_fit
from services.commands.options import MeshOption, TakeFolder, imported
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import check_place, write_actor
from services.mocap.take.fit_record import FIT_FOLDER
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR
from services.process import (
    DEFAULT_ENGINE,
    DEFAULT_SEGMENTER,
    BackendOption,
    SegmenterOption,
    engine_settings,
)
from services.runs.fit import init_frames
from services.runs.fit_files import origin_of


def fit(
    take: TakeFolder,
    out: Annotated[
        Path | None, typer.Option(help="Where actor.toml and pictures go; into the take by default.")
    ] = None,
    frames: Annotated[
        int | None, typer.Option(min=1, help="How many of the first frames; init_frames by default.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an actor.toml made by hand.")] = False,
    mesh: MeshOption = None,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
) -> None:
    """Fit the actor's shape and first poses to a take's first frames, and show how well that went."""
    opened = open_take(take)
    actor_toml = (out or take) / ACTOR
    check_place(actor_toml, force)
    folder = out or take / FIT_FOLDER
    engine, search = engine_settings(backend, DEFAULT_ENGINE.threads), SearchSettings()
    warnings: list[str] = []
    own = imported(mesh, warnings)
    found = fit_with_bar(opened, init_frames(opened, frames), engine, search, folder, stderr, own, segmenter)
    if out is None:
        write_actor(actor_toml, found.actor, origin_of(opened, found))
    warn([*warnings, *found.warnings])
    show_fit(found, opened, folder, stdout)
