"""run.json: what was run, with what, how long it took and, where the truth is known, how exact it is."""

import json
import platform
from collections import Counter
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from proto.messages import PROTOCOL_VERSION, Pose, TakeInfo
from services.mocap.body.actor import Actor
from services.mocap.export.report import joint_errors
from services.mocap.take.folder import Take
from services.mocap.take.layout import REFERENCE_JOINTS_CSV
from services.mocap.take.tables import read_joints_csv
from services.mocap.take.world import from_take_world
from services.mocap.types import Floats

_LIBRARIES = ("moderngl", "numpy", "numba", "opencv-contrib-python-headless", "pyzmq", "scipy")


def write_run_json(
    path: Path, take: Take, info: TakeInfo, actor: Actor, recorded: list[Pose], joints_world_m: Floats
) -> None:
    """Write the report; joints_world_m (N, 15, 3) are those of the recorded poses."""
    report: dict[str, Any] = {
        "take": {"name": info.take, "folder": str(take.folder), "frames": len(recorded), "fps": info.fps},
        "versions": {
            "xormocap": version("xormocap"),
            "protocol": PROTOCOL_VERSION,
            "python": platform.python_version(),
            **{name: version(name) for name in _LIBRARIES},
        },
        "settings": _settings(info, recorded),
        "units": {"length": "m", "angle": "rad", "energy": "px", "time": "s", "bvh_length": "m"},
        "actor": actor.model_dump(),
        "speed": _speed(recorded),
        "energy_px": {
            "median": float(np.median([message.energy_px for message in recorded])),
            "largest": max(message.energy_px for message in recorded),
        },
    }
    accuracy = _accuracy(take, recorded, joints_world_m)
    if accuracy is not None:
        report["accuracy"] = accuracy
    path.write_text(json.dumps(report, indent=2) + "\n")


def _settings(info: TakeInfo, recorded: list[Pose]) -> dict[str, Any]:
    """What was chosen, and which energy backends then did the work: a GPU may fail on the way."""
    return {
        "backend": info.backend,
        "backend_reason": info.backend_reason,
        "threads": info.threads,
        "frames_by_backend": dict(Counter(message.backend for message in recorded)),
        "worker_limbs_by_backend": recorded[-1].worker_backends,
        "search": info.search,
    }


def _speed(recorded: list[Pose]) -> dict[str, Any]:
    """Times of the frames after the first, whose pose has to be found from nothing."""
    steady = recorded[1:] or recorded
    seconds = {name: [message.seconds[name] for message in steady] for name in steady[0].seconds}
    return {
        "workers": recorded[-1].workers,
        "retries": recorded[-1].retries,
        "frames_per_s": len(steady) / sum(seconds["frame"]),
        "evaluations_per_frame": float(np.mean([message.evaluations for message in steady])),
        "first_frame_s": recorded[0].seconds["frame"],
        "median_s": {name: float(np.median(values)) for name, values in seconds.items()},
    }


def _accuracy(take: Take, recorded: list[Pose], joints_world_m: Floats) -> dict[str, Any] | None:
    """Joint errors against the take's reference, for the frames that it has."""
    path = take.folder / REFERENCE_JOINTS_CSV
    if not path.exists():
        return None
    reference = read_joints_csv(path)
    row_of = {int(frame): row for row, frame in enumerate(reference.frames)}
    known = [(n, row_of[message.frame]) for n, message in enumerate(recorded) if message.frame in row_of]
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
        "lost_limbs": [
            {"frame": recorded[ours[row]].frame, "joint": joint} for row, joint in errors.lost_limbs
        ],
    }
