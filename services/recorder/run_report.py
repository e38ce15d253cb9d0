"""run.json: settings, versions, times, of live poses their shots and latencies, and, with a reference, the
joint errors."""

import json
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from proto.messages import PROTOCOL_VERSION, Pose, TakeInfo
from services.mocap.body.actor import Actor
from services.mocap.export.formats import DEFAULT_FORMATS, FORMATS
from services.mocap.motion.settings import OutputSettings
from services.mocap.result.layout import JOINTS, POSES_SMOOTH, REPORT
from services.mocap.take.folder import Take
from services.mocap.take.layout import REFERENCE_JOINTS_CSV
from services.mocap.take.live_settings import fresh_s
from services.mocap.take.marks import LIMB_NAMES, PARTS, Marks
from services.mocap.take.tables import REFERENCE_JOINTS, from_take_world, read_joints_csv
from services.mocap.types import Floats

_LIBRARIES = ("moderngl", "numpy", "numba", "opencv-contrib-python-headless", "pyzmq", "scipy")

_MOTION_FILES = tuple(file for name in DEFAULT_FORMATS for file in FORMATS[name].files if file != REPORT)
_SMOOTHED = (POSES_SMOOTH, JOINTS, *_MOTION_FILES)
"""Files of the smoothed motion."""
_LEAST_STEP_S = 1e-6
LOST_LIMB_MM = 200.0
"""A joint farther than this from the reference counts as lost: the search fitted something else. Confidences
are stricter (lost_probability.LOST_M)."""


def write_run_json(
    path: Path,
    take: Take,
    info: TakeInfo,
    actor: Actor,
    recorded: list[Pose],
    marks: Marks | None,
    output: OutputSettings,
    joints_world_m: Mapping[str, Floats],
    known: Mapping[str, Any],
) -> None:
    """Write the report of the recorded poses (N) and their marks; None: they were not judged.

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
            **{name: _version_of(name) for name in _LIBRARIES},
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
        "trust": marks and _trust(marks),
        **known,
    }
    if info.is_live:
        report["live"] = live_report(info, recorded)
    for name, joints_m in joints_world_m.items():
        accuracy = _accuracy(take, recorded, joints_m, is_of_shots=info.is_live)
        if accuracy is not None:
            report[name] = accuracy
    path.write_text(json.dumps(report, indent=2) + "\n")


def _version_of(library: str) -> str:
    """Its version. A library may be missing, or here as another build with another name, as OpenCV often
    is."""
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed under this name"


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
    # A coordinator measures these stages one after the other; the paper's machines do all limbs at once.
    if all(name in seconds for name in PARTS):
        slowest_limb = np.max([seconds[name] for name in LIMB_NAMES], axis=0)
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
    frames = [recorded[row].frame for row in ours]
    return joint_errors(frames, joints_world_m[ours], truth_world_m)


def joint_errors(frames: Sequence[int], estimated_m: Floats, reference_m: Floats) -> dict[str, Any]:
    """How far the joints of N frames are from the reference; both (N, 15, 3) in metres in one world, and
    finite, as messages and tables are."""
    errors_mm = 1000.0 * np.linalg.norm(estimated_m - reference_m, axis=-1)
    lost = np.argwhere(errors_mm > LOST_LIMB_MM)
    return {
        "frames": len(frames),
        "mean_mm": float(errors_mm.mean()),
        "median_mm": float(np.median(errors_mm)),
        "p95_mm": float(np.percentile(errors_mm, 95)),
        "mean_by_joint_mm": dict(zip(REFERENCE_JOINTS, errors_mm.mean(axis=0).tolist(), strict=True)),
        "frames_with_lost_limbs": len({int(row) for row, _ in lost}),
        "lost_limbs": [{"frame": frames[row], "joint": REFERENCE_JOINTS[joint]} for row, joint in lost],
    }


def increasing(times_s: Floats) -> Floats:
    """Times (N,), made strictly increasing: cameras' stamps may jitter."""
    steps_s = np.arange(len(times_s)) * _LEAST_STEP_S
    later: Floats = np.maximum.accumulate(times_s - steps_s) + steps_s
    return later


def rate_fps(info: TakeInfo, recorded: Sequence[Pose]) -> float:
    """Frames per second of the results: those of the recording, or the mean of live poses."""
    if not info.is_live or len(recorded) < 2:
        return info.fps
    lasted_s = recorded[-1].time_s - recorded[0].time_s
    return (len(recorded) - 1) / lasted_s if lasted_s > 0 else info.fps


def since_abreast(times_s: Floats, latencies_s: Floats, fps: float) -> dict[str, Any] | None:
    """When poses (N,) with these times and latencies were first abreast of the cameras, and the latency since
    then.

    Earlier poses belong to shots that waited during the search for the first pose. None: never abreast.
    """
    is_abreast = latencies_s <= fresh_s(fps)
    if not is_abreast.any():
        return None
    first = int(is_abreast.argmax())
    after_s = float(times_s[first] + latencies_s[first] - times_s[0])
    return {"after_s": after_s, "poses_before": first, "latency_s": _latency_s(latencies_s[first:])}


def _latency_s(latencies_s: Floats) -> dict[str, float]:
    median_s, p95_s = np.percentile(latencies_s, [50, 95])
    return {"median": float(median_s), "p95": float(p95_s)}


def live_report(info: TakeInfo, recorded: Sequence[Pose]) -> dict[str, Any]:
    """For run.json: latencies of the poses, also since they caught up, and the number of shots."""
    latencies_s = np.array([message.latency_s for message in recorded])
    times_s = np.array([message.time_s for message in recorded])
    return {
        "latency_s": _latency_s(latencies_s),
        "abreast": since_abreast(times_s, latencies_s, info.fps),
        "shots": {
            "first": recorded[0].shot,
            "last": recorded[-1].shot,
            "solved": len(recorded),
            "with_absent_cameras": sum(bool(message.absent) for message in recorded),
        },
    }
