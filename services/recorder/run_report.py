"""run.json: settings, versions, times and, with a reference, the joint errors."""

import json
import platform
from collections import Counter
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from proto.messages import PROTOCOL_VERSION, Pose, TakeInfo
from services.mocap.body.actor import Actor
from services.mocap.export.joint_accuracy import joint_errors
from services.mocap.motion.settings import OutputSettings
from services.mocap.result.layout import ANGLES, BVH, C3D, GLB, JOINTS, POSES_SMOOTH, TRC
from services.mocap.take.folder import Take
from services.mocap.take.layout import REFERENCE_JOINTS_CSV
from services.mocap.take.marks import PARTS, Marks
from services.mocap.take.tables import from_take_world, read_joints_csv
from services.mocap.types import Floats
from services.recorder.live import is_live, live_report, rate_fps

_LIBRARIES = ("moderngl", "numpy", "numba", "opencv-contrib-python-headless", "pyzmq", "scipy")

_SMOOTHED = (POSES_SMOOTH, JOINTS, BVH, GLB, TRC, C3D, ANGLES)
"""Files of the smoothed motion."""
_LIMBS = ("left_arm", "right_arm", "left_leg", "right_leg")
"""Stages that the paper's five machines run in parallel, while a coordinator measures them one after the
other."""


def write_run_json(
    path: Path,
    take: Take,
    info: TakeInfo,
    actor: Actor,
    recorded: list[Pose],
    marks: Marks,
    output: OutputSettings,
    joints_world_m: Mapping[str, Floats],
    known: Mapping[str, Any],
) -> None:
    """Write the report of the recorded poses (N).

    joints_world_m: joints (N, 15, 3) of which the report tells the accuracy, by the name that it has there.
    known: further entries, from who started the run.
    """
    smoothing: dict[str, Any] = {"smooth": output.smooth}
    if output.smooth != "none":
        smoothing |= {"cutoff_hz": output.cutoff_hz, "smoothed": list(_SMOOTHED)}
    report: dict[str, Any] = {
        "take": {
            "name": info.take,
            "folder": str(take.folder),
            "frames": len(recorded),
            "fps": rate_fps(info, recorded),
            "up": take.settings.up,
            "longest_side": take.settings.longest_side,
            "actor_height": take.settings.actor_height,
        },
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "xormocap": version("xormocap"),
            "protocol": PROTOCOL_VERSION,
            "python": platform.python_version(),
            **{name: version(name) for name in _LIBRARIES},
        },
        "settings": _settings(info, recorded),
        "output": smoothing,
        "units": {"length": "m", "angle": "rad", "energy": "px", "time": "s", "bvh_length": "m"},
        "actor": actor.model_dump(),
        "speed": _speed(recorded),
        "energy_px": {
            "median": float(np.median([message.energy_px for message in recorded])),
            "largest": max(message.energy_px for message in recorded),
        },
        "trust": _trust(marks),
        **known,
    }
    if is_live(info):
        report["live"] = live_report(info, recorded)
    for name, joints_m in joints_world_m.items():
        accuracy = _accuracy(take, recorded, joints_m, is_of_shots=is_live(info))
        if accuracy is not None:
            report[name] = accuracy
    path.write_text(json.dumps(report, indent=2) + "\n")


def _settings(info: TakeInfo, recorded: list[Pose]) -> dict[str, Any]:
    """The settings, and the energy backends that did the work: a GPU may fail during the run."""
    return {
        "backend": info.backend,
        "backend_reason": info.backend_reason,
        "threads": info.threads,
        "frames_by_backend": dict(Counter(message.backend for message in recorded)),
        "worker_limbs_by_backend": recorded[-1].worker_backends,
        "search": info.search,
    }


def _speed(recorded: list[Pose]) -> dict[str, Any]:
    """Times of the frames after the first, whose pose is searched without a start."""
    steady = recorded[1:] or recorded
    stages = sorted({name for message in steady for name in message.seconds})
    seconds = {name: np.array([message.seconds.get(name, 0.0) for message in steady]) for name in stages}
    speed = {
        "workers": recorded[-1].workers,
        "retries": recorded[-1].retries,
        "frames_per_s": float(1.0 / seconds["frame"].mean()),
        "evaluations_per_frame": float(np.mean([message.evaluations for message in steady])),
        "first_frame_s": recorded[0].seconds["frame"],
        "mean_s": {name: float(values.mean()) for name, values in seconds.items()},
        "median_s": {name: float(np.median(values)) for name, values in seconds.items()},
    }
    if all(name in seconds for name in (*_LIMBS, "torso", "head")):
        slowest_limb = np.max([seconds[name] for name in _LIMBS], axis=0)
        speed["critical_path_s"] = float((seconds["torso"] + slowest_limb + seconds["head"]).mean())
    return speed


def _trust(marks: Marks) -> dict[str, Any]:
    """The number of frames in which each part is unreliable; parts that were never judged have no
    confidence."""
    judged = {
        part: float(np.nanmin(values))
        for part, values in zip(PARTS, marks.confidence.T, strict=True)
        if not np.isnan(values).all()
    }
    return {
        "distrusted_frames": marks.distrusted_frames,
        "distrusted_frames_by_part": marks.distrusted_by_part,
        "lowest_confidence": judged,
    }


def _accuracy(
    take: Take, recorded: list[Pose], joints_world_m: Floats, *, is_of_shots: bool
) -> dict[str, Any] | None:
    """Joint errors against the take's reference, for the frames in it."""
    path = take.folder / REFERENCE_JOINTS_CSV
    if not path.exists():
        return None
    reference = read_joints_csv(path)
    row_of = {int(frame): row for row, frame in enumerate(reference.frames)}
    moments = [message.shot if is_of_shots else message.frame for message in recorded]
    known = [(n, row_of[moment]) for n, moment in enumerate(moments) if moment in row_of]
    if not known:
        return None
    ours, theirs = (list(rows) for rows in zip(*known, strict=True))
    truth_world_m = from_take_world(reference.joints_take_m[theirs], take.settings.up)
    errors = joint_errors(joints_world_m[ours], truth_world_m)
    return {
        "frames": len(known),
        "mean_mm": errors.mean_mm,
        "median_mm": errors.median_mm,
        "p95_mm": errors.p95_mm,
        "mean_by_joint_mm": errors.mean_by_joint_mm,
        "frames_with_lost_limbs": len({row for row, _ in errors.lost_limbs}),
        "lost_limbs": [
            {"frame": recorded[ours[row]].frame, "joint": joint} for row, joint in errors.lost_limbs
        ],
    }
