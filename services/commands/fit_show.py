"""What `xormocap fit` shows: a bar while it works, then the actor's measures and the fit in each camera."""

from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from services.commands.consoles import stderr
from services.mocap.energy.settings import EngineSettings
from services.mocap.take.fit_record import OVERLAY, TURNTABLE
from services.mocap.take.folder import Take
from services.runs.fit import Show, TakeFit
from services.runs.fit_files import frames_in_words, uncertainty_of, write_fit

_EVERY_CORE = 0
_HEIGHT_CM = 2.0
"""Further than this from the height in take.toml a fitted one is worth a word."""


def with_every_core(engine: EngineSettings) -> EngineSettings:
    """An engine's settings while no other process computes."""
    return engine.model_copy(update={"threads": _EVERY_CORE})


def fit_with_bar(take: Take, folder: Path, work: Callable[[Show], TakeFit]) -> TakeFit:
    """Fit the actor of a take by fit_take or refine_take, and write what was found into a folder."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=stderr) as bar:
        task = bar.add_task("starting", total=1.0)

        def show(stage: str, share: float) -> None:
            bar.update(task, completed=share, description=stage)

        found = work(show)
        bar.update(task, description="drawing")
        write_fit(take, found, folder)
        show("fitted", 1.0)
    return found


def show_fit(found: TakeFit, take: Take, folder: Path, console: Console) -> None:
    """Print the tables, and where the pictures are."""
    console.print(_measures(found))
    console.print()
    console.print(_quality(found))
    told_m, height_m = take.settings.actor_height, found.measures[0].cm / 100.0
    if told_m is not None and abs(height_m - told_m) > _HEIGHT_CM / 100.0:
        console.print(
            f"take.toml says actor_height = {told_m:.2f} m, the silhouettes {height_m:.2f} m: "
            "check that number, or the scale of the calibration",
            style="yellow",
            soft_wrap=True,
        )
    pictures = f"look at {folder / OVERLAY} and {folder / TURNTABLE}"
    console.print(pictures, markup=False, highlight=False, soft_wrap=True)


def _measures(found: TakeFit) -> Table:
    table = Table("measure", box=None, header_style="bold")
    table.add_column("cm", justify="right")
    table.add_column("±", justify="right")
    table.add_column("how to check it")
    for row in found.measures:
        table.add_row(row.name, f"{row.cm:.1f}", uncertainty_of(row), row.how)
    return table


def _quality(found: TakeFit) -> Table:
    """Means over the frames."""
    before, after = found.fit.before, found.fit.after
    table = Table(frames_in_words(found), box=None, header_style="bold")
    for column in ("before", "after"):
        table.add_column(column, justify="right")
    energies = (f"{quality.energy_px.mean():.0f}" for quality in (before, after))
    table.add_row("energy per frame, px", *energies)
    for c, camera in enumerate(found.cameras):
        ious = (f"{quality.iou[:, c].mean():.3f}" for quality in (before, after))
        table.add_row(f"IoU, {escape(camera.name)}", *ious)
    table.add_row("IoU, all cameras", f"{before.iou.mean():.3f}", f"{after.iou.mean():.3f}")
    return table
