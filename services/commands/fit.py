"""`xormocap fit`: the actor's shape and first poses, with a bar, and what came of it in numbers."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated, TypeAlias

import typer
from rich.markup import escape

from services.commands.actor_in_view import in_view
from services.commands.checks import (
    CheckOption,
    blamed_first,
    check_files,
    compare_cameras,
    look_before,
    not_told,
)
from services.commands.consoles import TakeFolder, progress_bar, say, stdout, table_of, warn
from services.mocap.body.own_mesh.mesh_import import import_mesh
from services.mocap.errors import TakeError, UserError
from services.mocap.result.words import ENERGY_IN_WORDS, IOU_IN_WORDS
from services.mocap.search.lacking_ends import LACKING_REMEDY, lacking_in_words
from services.mocap.search.overrides import search_settings
from services.mocap.take.actor_file import check_place, take_actor, write_actor
from services.mocap.take.fit_record import FIT_FOLDER, OVERLAY, TURNTABLE, was_refined
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import ACTOR
from services.mocap.verdict.verdict import Cause
from services.options import (
    DEFAULT_ENGINE,
    DEFAULT_SEGMENTER,
    BackendOption,
    BodyOption,
    SegmenterOption,
    engine_settings,
)
from services.runs.fit import fit_take, init_frames
from services.runs.fit_files import origin_of, uncertainty_of, write_fit
from services.runs.refine import DEFAULT_REFINE_FRAMES, refine_take
from services.runs.reporting import DRAWING_FROM, Show
from services.runs.take_fit import LEAST_USUAL_IOU, TakeFit, frames_in_words
from services.runs.take_silhouettes import TakeSilhouettes

EVERY_CORE = 0
"""Threads of the energy while no other process computes."""
_HEIGHT_CM = 2.0
"""A fitted height that differs by more than this from that in take.toml causes a warning."""
MeshOption: TypeAlias = Annotated[
    Path | None, typer.Option(help="Fit this mesh: a skinned character (.glb) or named parts (.obj, .glb).")
]


def fit(
    take: TakeFolder,
    out: Annotated[
        Path | None, typer.Option(help="Folder for actor.toml and pictures; by default the take.")
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of frames: by default the first init_frames; with --refine, 16 of the whole take.",
        ),
    ] = None,
    refine: Annotated[
        Path | None,
        typer.Option(
            metavar="RESULT", help="Start from the poses of this result, and use frames of the whole take."
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace an actor.toml made by hand, or fitted to the whole take.")
    ] = False,
    mesh: MeshOption = None,
    body: BodyOption = None,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    check: CheckOption = True,
) -> None:
    """Fit the actor's shape and first poses to a take's first frames, and show how good the fit is."""
    if refine is not None and mesh is not None:
        raise UserError("--refine: uses the body of RESULT: leave out --mesh")
    opened = open_take(take)
    warn(opened.remarks)
    actor_toml = (out or take) / ACTOR
    check_place(actor_toml, force)
    if out is None and refine is None and not force:
        _check_not_refined(opened)
    folder = out or take / FIT_FOLDER
    search = search_settings([], None, len(opened.cameras), body=body)
    own = None if mesh is None else import_mesh(mesh)
    silhouettes = TakeSilhouettes(opened, segmenter)
    first, checks = init_frames(opened, frames), tuple[Cause, ...]()
    if check:
        check_files(silhouettes)
        compared = compare_cameras(silhouettes, first)
        if refine is None:
            from_there = in_view(silhouettes, range(opened.settings.frames))
            first = init_frames(opened, frames, from_there.start)
        checks = look_before(silhouettes, first, compared)
    if refine is not None:
        count = frames or DEFAULT_REFINE_FRAMES
        work = partial(refine_take, silhouettes, refine, count, body=search.body)
    else:
        work = partial(
            fit_take,
            silhouettes,
            first,
            engine_settings(backend, EVERY_CORE),
            search,
            mesh=None if own is None else own.mesh,
        )
    with blamed_first(checks):
        found = fit_with_bar(opened, folder, work)
    if out is None:
        write_actor(actor_toml, found.actor, origin_of(opened, found))
    warn(not_told([*(() if own is None else own.remarks), *found.warnings], checks))
    if found.lacking:
        warn([f"{lacking_in_words(found.lacking)}: {LACKING_REMEDY}"])
    show_fit(found, opened, folder)


def _check_not_refined(take: Take) -> None:
    """Raise UserError if the take's body was fitted to frames of the whole take, which is better."""
    actor = take_actor(take)
    with suppress(TakeError):  # a record that cannot be read is replaced
        if actor is not None and was_refined(take.folder / FIT_FOLDER, actor):
            raise UserError(
                f"{take.folder / ACTOR}: was fitted to frames of the whole take, and is better than a fit to "
                "the first ones: keep it and give --out, or replace it with --force"
            )


def fit_with_bar(take: Take, folder: Path, work: Callable[[Show], TakeFit]) -> TakeFit:
    """Fit the actor of a take by fit_take or refine_take, and write the result into a folder."""
    with progress_bar() as show:
        found = work(show)
        show("drawing", DRAWING_FROM)
        write_fit(take, found, folder)
        show("fitted", 1.0)
    return found


def show_fit(found: TakeFit, take: Take, folder: Path) -> None:
    """Print the measures, how well the frames are covered before and after, and where the pictures are."""
    measures = table_of("measure", "cm", "±")
    measures.add_column("how to measure it")
    for row in found.measures:
        measures.add_row(row.name, f"{row.cm:.1f}", uncertainty_of(row), row.how)
    before, after = found.fit.before, found.fit.after
    quality = table_of(frames_in_words(found), "before", "after")
    energies = (f"{of.energy_px.mean():.0f}" for of in (before, after))
    quality.add_row("energy per frame, px", *energies)
    for c, camera in enumerate(found.cameras):
        ious = (f"{of.iou[:, c].mean():.3f}" for of in (before, after))
        quality.add_row(f"IoU, {escape(camera.name)}", *ious)
    quality.add_row("IoU, all cameras", f"{before.iou.mean():.3f}", f"{after.iou.mean():.3f}")
    stdout.print(measures)
    stdout.print()
    stdout.print(quality)
    for sentences in (ENERGY_IN_WORDS, IOU_IN_WORDS):
        say(sentences)
    told_m, height_m = take.settings.actor_height, found.measures[0].cm / 100.0
    if told_m is not None and abs(height_m - told_m) > _HEIGHT_CM / 100.0:
        say(
            f"take.toml has actor_height = {told_m:.2f} m, the silhouettes give {height_m:.2f} m: "
            "check that number, or the scale of the calibration",
            style="yellow",
        )
    if found.iou < LEAST_USUAL_IOU:
        say(
            f"body and silhouettes overlap less than usual ({found.iou:.2f}): if a limb is wrong in "
            f"{folder / OVERLAY}, track the take, and fit again with --refine",
            style="yellow",
        )
    say(f"look at {folder / OVERLAY} and {folder / TURNTABLE}")
