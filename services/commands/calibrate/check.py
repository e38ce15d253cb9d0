"""`xormocap calibrate --check TAKE`: checks with silhouettes alone whether a take's cameras agree."""

from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from services.commands.consoles import progress_bar, stdout, table_of, warn
from services.mocap.calibration.epipolar_tangents import TangentAgreement, agreement_of
from services.mocap.calibration.remarks import remarks_on
from services.mocap.calibration.trials import undone_mistake
from services.mocap.camera.rig import Rig
from services.mocap.errors import TakeError
from services.mocap.search.agreement import filled_by_others
from services.mocap.take.folder import open_take
from services.mocap.types import ACTOR, BACKGROUND, Floats
from services.runs.outlines import outlines_of
from services.runs.take_silhouettes import TakeSilhouettes

_MOST_FRAMES = 60
_FEWEST_CAMERAS = 2


def check_take(folder: Path) -> None:
    """Print the error of every camera, and raise TakeError if one does not agree, with the cause if known."""
    take = open_take(folder)
    warn(take.remarks)
    if len(take.cameras) < _FEWEST_CAMERAS:
        raise TakeError(f"{folder}: has only one camera: expected at least two cameras to compare")
    n_frames = take.settings.frames
    frames = range(0, n_frames, -(-n_frames // _MOST_FRAMES))
    with progress_bar() as show:
        cameras, outlines, middle = outlines_of(
            take, frames, lambda share: show("looking at silhouettes", share)
        )
    found = agreement_of(cameras, outlines)
    names = [camera.name for camera in cameras]
    is_known = np.isfinite(found.off_px).any()
    certain = None
    if (found.odd or not is_known) and TakeSilhouettes(take).has_stage:
        certain = undone_mistake(cameras, outlines, take.settings.up)
    if not is_known and certain is None:
        raise TakeError(
            f"{folder}: silhouettes: no two cameras show the whole actor: nothing can be compared"
        )
    filled = filled_by_others(Rig.of(cameras), middle == ACTOR, middle != BACKGROUND)
    stdout.print(_table(names, found, filled))
    warn(remarks_on(cameras))
    unseen = [name for name, off_px in zip(names, found.off_px, strict=True) if not np.isfinite(off_px)]
    if unseen and is_known:
        them = ", ".join(unseen)
        warn([f"silhouettes: {them}: nobody is whole in them, so nothing was compared: look at them"])
    if certain is not None:
        raise TakeError(f"{folder}/{certain}")
    if not found.odd:
        return
    good = found.good
    others = f"the other {len(good)} cameras" if len(good) > 1 else f"any of the {len(names)} cameras"
    odd = ", ".join(names[c] for c in found.odd)
    advice = (
        "check calibration, synchronisation (xormocap sync) and silhouettes; a camera whose silhouettes "
        "the others' hull covers by 100 % may be right: then furniture hides part of the actor from it"
    )
    raise TakeError(f"{folder}: {odd}: not in agreement with {others}: {advice}")


def _table(names: list[str], found: TangentAgreement, filled: Floats) -> Table:
    table = table_of("camera", "off, px", "covered by the others' hull", "")
    for c, name in enumerate(names):
        known = np.isfinite(found.off_px[c])
        verdict = "[red]does not agree[/]" if c in found.odd else "agrees" if known else "unknown"
        table.add_row(
            escape(name),
            f"{found.off_px[c]:.1f}" if known else "-",
            f"{100 * filled[c]:.0f}%" if np.isfinite(filled[c]) else "-",
            verdict,
        )
    return table
