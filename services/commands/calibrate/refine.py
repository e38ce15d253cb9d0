"""`xormocap calibrate TAKE --refine RESULT`: extrinsics refined by the body that was tracked."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table
from scipy.spatial.transform import Rotation

from services.commands.consoles import progress_bar, say, stdout, table_of, warn
from services.mocap.camera.calibration import write_calibration
from services.mocap.camera.camera import Camera
from services.mocap.errors import CalibrationError, UserError
from services.mocap.take.folder import open_take
from services.mocap.take.layout import CALIBRATION
from services.runs.refine_cameras import TakeCameras, refine_take_cameras

REFINED = "calibration-refined.toml"
_REPLACED = "calibration-before.toml"


def refine_take(folder: Path, result: Path, out: Path | None) -> None:
    """Write the take's cameras, moved to where the result's body agrees with them, and print how they moved.

    out: the file to write, by default calibration-refined.toml in the take. Raises UserError for input that
    cannot be used, and CalibrationError, with nothing written, if frames that were kept out get no better.
    """
    out, calibration = out or folder / REFINED, folder / CALIBRATION
    if out.resolve() == calibration.resolve():
        raise UserError(f"--out {out}: is the calibration that is refined: name another file")
    take = open_take(folder)
    warn(take.remarks)
    with progress_bar() as show:
        found = refine_take_cameras(take, result, show)
    warn(found.warnings)
    refined = found.refined
    stdout.print(_table(found))
    if refined.held.all():
        raise CalibrationError(
            f"{calibration}: agrees with the body of {result}: no camera moves: nothing is written"
        )
    if not refined.is_better:
        raise CalibrationError(
            f"{calibration}: other extrinsics fit frames that were kept out no better: nothing is written; "
            "look for wrong silhouettes (xormocap segment) and cameras out of step (xormocap sync)"
        )
    moved = (
        replace(old, R_camera_world=new.R_camera_world, t_camera_world_m=new.t_camera_world_m)
        for old, new in zip(take.calibrated, refined.cameras, strict=True)
    )
    write_calibration(out, tuple(moved), take.settings.up)
    say(
        f"{out}; to track with it: mv {calibration} {folder / _REPLACED} && mv {out} {calibration} && "
        f"xormocap track {folder} --out {result}"
    )


def _table(found: TakeCameras) -> Table:
    """Each camera's overlap with the body in frames that were kept out, and how it moved."""
    refined = found.refined
    table = table_of("camera", "IoU before", "after", "turned, degrees", "moved, mm", "")
    ious = zip(refined.before.iou.mean(axis=0), refined.after.iou.mean(axis=0), strict=True)
    for old, new, (before, after), is_held in zip(
        found.cameras, refined.cameras, ious, refined.held, strict=True
    ):
        turned_deg, moved_mm = moved_by(old, new)
        moved = ("-", "-", "held") if is_held else (f"{turned_deg:.2f}", f"{moved_mm:.0f}", "")
        table.add_row(escape(old.name), f"{before:.3f}", f"{after:.3f}", *moved)
    return table


def moved_by(old: Camera, new: Camera) -> tuple[float, float]:
    """How far a camera turned, in degrees, and moved, in millimetres."""
    turn = Rotation.from_matrix(new.R_camera_world @ old.R_camera_world.T)
    away_m = np.linalg.norm(new.centre_world_m - old.centre_world_m)
    return float(np.degrees(turn.magnitude())), 1e3 * float(away_m)
