"""`xormocap calibrate --check TAKE`: whether a take's cameras agree, by silhouettes alone."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from services.commands.consoles import warn
from services.commands.take_outlines import outlines_of
from services.mocap.calibration.agreeing import Agreement, agreement_of, filled_by_others, likely_mistake
from services.mocap.calibration.remarks import remarks_on
from services.mocap.camera.rig import Rig
from services.mocap.errors import TakeError
from services.mocap.take.folder import open_take
from services.mocap.types import ACTOR, BACKGROUND, Floats

_MOST_FRAMES = 60
_FEWEST_CAMERAS = 2


class DisagreeError(TakeError):
    """A camera does not agree with the others."""


def check_take(folder: Path, console: Console, errors: Console) -> None:
    """Print for every camera how far it is off, and raise DisagreeError where one does not agree."""
    take = open_take(folder)
    if len(take.cameras) < _FEWEST_CAMERAS:
        raise TakeError(f"{folder}: has one camera: expected two or more to compare")
    frames = range(take.settings.frames)
    cameras, outlines, middle = outlines_of(take, frames, -(-len(frames) // _MOST_FRAMES), errors)
    found = agreement_of(cameras, outlines)
    names = [camera.name for camera in cameras]
    if not np.isfinite(found.off_px).any():
        raise TakeError(
            f"{folder}: silhouettes: the actor is whole in no two cameras: nothing can be compared"
        )
    filled = filled_by_others(Rig.of(cameras), middle == ACTOR, middle != BACKGROUND)
    console.print(_table(names, found, filled))
    warn(remarks_on(cameras), errors)
    if not found.odd:
        return
    good = [c for c in range(len(cameras)) if c not in found.odd and np.isfinite(found.off_px[c])]
    mistakes = {
        names[c]: likely_mistake(c, cameras, good, outlines, float(found.off_px[c]))
        if len(good) > 1
        else None
        for c in found.odd
    }
    words = ", ".join(
        name + (f" (its pictures are {what})" if what else "") for name, what in mistakes.items()
    )
    advice = "check its calibration, its synchronisation (xormocap sync) and its silhouettes"
    raise DisagreeError(f"{folder}: {words}: not in agreement with {_others(names, good)}: {advice}")


def _others(names: list[str], good: list[int]) -> str:
    return f"the other {len(good)} cameras" if len(good) > 1 else f"any of the {len(names)} cameras"


def _table(names: list[str], found: Agreement, filled: Floats) -> Table:
    table = Table("camera", box=None, header_style="bold")
    for column in ("off, px", "filled by the others' hull", ""):
        table.add_column(column, justify="right")
    for c, name in enumerate(names):
        known = np.isfinite(found.off_px[c])
        verdict = "[red]does not agree[/]" if c in found.odd else "agrees" if known else "cannot be told"
        table.add_row(
            escape(name),
            f"{found.off_px[c]:.1f}" if known else "-",
            f"{100 * filled[c]:.0f}%" if np.isfinite(filled[c]) else "-",
            verdict,
        )
    return table
