"""A take's results as files."""

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from services.mocap.body.actor import build_body
from services.mocap.errors import UserError
from services.mocap.export.formats import DEFAULT_FORMATS, write_defaults
from services.mocap.export.overlay import write_overlay
from services.mocap.motion.settings import OutputSettings
from services.mocap.motion.smoothing import cutoff_of, smoothed
from services.mocap.result.frame_files import write_frame_files
from services.mocap.result.layout import CORRECTED_FRAMES, OVERLAY, RUN_JSON
from services.mocap.result.result import edited_run, load_result, write_tracked
from services.mocap.search.best_path import corrected_frames
from services.mocap.take.folder import Take
from services.mocap.take.moved_cameras import write_moved
from services.mocap.take.tables import PoseTable, reference_joints
from services.mocap.types import Ints
from services.mocap.verdict.judging import verdict_of
from services.recorder.collection import Collection
from services.recorder.result_folder import results_into
from services.recorder.run_report import increasing, write_run_json

log = logging.getLogger(__name__)


def write_results(
    out: Path,
    take: Take,
    collection: Collection,
    output: OutputSettings,
    *,
    overlay: bool,
    report: bool,
    hurry: Callable[[], bool],
    known: Mapping[str, Any] | None = None,
) -> bool:
    """Write poses.csv, joints.csv, actor.toml, run.json, the DEFAULT_FORMATS, and overlay.mp4 if wanted.

    Returns whether every requested frame was written as it stays (Collection.is_final).

    With smoothing, poses.csv and the overlay still show the poses as tracked; joints.csv, the exported motion
    and poses_smooth.csv have the smoothed motion. Older results are replaced once the new ones are written,
    unless these are not whole (see results_into). hurry: called at every frame of the overlay, which is left
    out if it returns True. known: further entries of run.json, from who started the run. Raises UserError if
    there is nothing to write.
    """
    info, recorded = collection.info, collection.recorded()
    if info is None or not recorded or collection.missing_blobs():
        raise UserError("no results: the coordinator exited before it described the take")
    actor = collection.actor()
    body = build_body(actor)
    frames: Ints = np.array([message.frame for message in recorded], np.int32)
    times_s, live = increasing(np.array([message.time_s for message in recorded])), info.is_live
    table = PoseTable.of(frames, times_s, recorded, is_live=live)
    poses, known = table.poses, dict(known or {})
    if any(message.settled for message in recorded):
        first_poses = np.array([message.pose for message in collection.first_poses()])
        known[CORRECTED_FRAMES] = corrected_frames(first_poses, poses, body.offsets_m)
    output = output.model_copy(update={"cutoff_hz": cutoff_of(poses, info.fps, output)})
    shown = smoothed(poses, info.fps, output, times_s if live else None)
    is_whole = collection.complete if live else collection.is_final
    with results_into(out, complete=is_whole) as part:
        smooth = shown if output.smooth != "none" else None
        joints_world_m = {"accuracy": write_tracked(part, table, actor, take.settings.up, smooth)}
        if smooth is not None:
            joints_world_m["accuracy_before_smoothing"] = reference_joints(poses, body.offsets_m)
        stages = sorted({stage for message in recorded for stage in message.seconds})
        write_frame_files(part, frames, recorded, stages, take.camera_names)
        write_run_json(
            part / RUN_JSON, take, info, actor, recorded, table.marks, output, joints_world_m, known
        )
        write_moved(part, take)
        result = load_result(part)
        verdict = verdict_of(result, out)
        with edited_run(part) as run:
            run["verdict"] = verdict.model_dump()
        if overlay:
            log.info("drawing the overlay")
            write_overlay(part / OVERLAY, take, body, table, result.fps, verdict, hurry)
        formats = [name for name in DEFAULT_FORMATS if report or name != "report"]
        write_defaults(part, result, formats, log.warning)
    return is_whole
