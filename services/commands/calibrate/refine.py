"""`xormocap calibrate TAKE --refine RESULT`: extrinsics refined by the body that was tracked."""

from pathlib import Path
from shlex import quote

import numpy as np
from rich.markup import escape
from rich.table import Table

from services.commands.consoles import progress_bar, say, stdout, table_of, warn
from services.mocap.calibration.from_body import Refined, refine_cameras
from services.mocap.camera.calibration import write_calibration
from services.mocap.camera.camera import Camera, moved_by
from services.mocap.energy.bitplanes import TriPlanes, pack_trimaps
from services.mocap.errors import CalibrationError, TakeError, UserError
from services.mocap.result.words import IOU_IN_WORDS
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import CALIBRATION
from services.mocap.take.moved_cameras import moved_take
from services.runs.camera_placing import PLACING_FRAMES
from services.runs.refine import result_of, spread
from services.runs.reporting import Show, kept_warnings
from services.runs.take_silhouettes import trimaps_of
from services.segmentation.segmenters import make_segmenter

REFINED = "calibration-refined.toml"
_REPLACED = "calibration-before.toml"
_LEAST_FRAMES = 8
_FEWEST_CAMERAS = 2
_SEEN_AT = 0.2
"""Progress once all silhouettes are there."""


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
        refined, warnings = refine_take_cameras(take, result, show)
    warn(warnings)
    stdout.print(_table(take.cameras, refined))
    say(IOU_IN_WORDS)
    if refined.held.all():
        raise CalibrationError(
            f"{calibration}: agrees with the body of {result}: no camera moves: nothing is written"
        )
    if not refined.is_better:
        raise CalibrationError(
            f"{calibration}: other extrinsics fit frames that were kept out no better: nothing is written; "
            "look for wrong silhouettes (xormocap segment) and cameras out of step (xormocap sync)"
        )
    write_calibration(out, moved_take(take, refined.cameras).calibrated, take.settings.up)
    old, new, kept, take_folder, results = (
        quote(str(path)) for path in (calibration, out, folder / _REPLACED, folder, result)
    )
    say(
        f"{out}; to track with it: mv {old} {kept} && mv {new} {old} && "
        f"xormocap track {take_folder} --out {results}"
    )


def refine_take_cameras(take: Take, result: Path, show: Show) -> tuple[Refined, list[str]]:
    """Refine a take's cameras by the body and poses of a result, in frames spread over those without a mark;
    returns warnings too.

    Silhouettes are made as for the result. Cameras that a fit would leave out, because they disagree with
    the others, are among them. Raises UserError if the result cannot be used, belongs to another take or has
    fewer than eight such frames, and TakeError if there is but one camera.
    """
    if len(take.cameras) < _FEWEST_CAMERAS:
        raise TakeError(
            f"{take.folder}: has only one camera: expected at least two, since one agrees with any motion"
        )
    found = result_of(take, result)
    marked = np.asarray(found.distrusted.any(axis=1), bool)
    if np.count_nonzero(~marked) < _LEAST_FRAMES:
        raise UserError(f"--refine {found.folder}: expected at least {_LEAST_FRAMES} frames without a mark")
    rows = spread(marked, PLACING_FRAMES)
    frames = tuple(found.tracked.frames[rows].tolist())
    with kept_warnings() as warnings:
        made = make_segmenter(take, take.cameras, found.segmenter)
        trimaps = trimaps_of(
            take, frames, made, lambda share: show("looking at silhouettes", _SEEN_AT * share)
        )
        refined = refine_cameras(
            take.cameras,
            TriPlanes.of_frames([pack_trimaps(of_frame) for of_frame in trimaps]),
            found.actor,
            found.tracked.poses[rows],
            lambda share: show("refining the cameras", _SEEN_AT + (1.0 - _SEEN_AT) * share),
        )
    return refined, warnings


def _table(cameras: tuple[Camera, ...], refined: Refined) -> Table:
    """Each camera's overlap with the body in frames that were kept out, and how it moved."""
    table = table_of("camera", "IoU before", "after", "turned, degrees", "moved, mm", "")
    ious = zip(refined.before.iou.mean(axis=0), refined.after.iou.mean(axis=0), strict=True)
    for old, new, (before, after), is_held in zip(cameras, refined.cameras, ious, refined.held, strict=True):
        turned_deg, moved_mm = moved_by(old, new)
        moved = ("-", "-", "held") if is_held else (f"{turned_deg:.2f}", f"{moved_mm:.0f}", "")
        table.add_row(escape(old.name), f"{before:.3f}", f"{after:.3f}", *moved)
    return table
