"""Quantities of live poses only: their shots and latencies."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from proto.messages import OPEN_END, Pose, TakeInfo
from services.mocap.take.live_settings import fresh_s
from services.mocap.types import Floats

_LEAST_STEP_S = 1e-6


def is_live(info: TakeInfo) -> bool:
    """Whether the poses are of live input."""
    return info.end_frame == OPEN_END


def increasing(times_s: Floats) -> Floats:
    """Times (N,), made strictly increasing: cameras' stamps may jitter."""
    steps_s = np.arange(len(times_s)) * _LEAST_STEP_S
    later: Floats = np.maximum.accumulate(times_s - steps_s) + steps_s
    return later


def rate_fps(info: TakeInfo, recorded: Sequence[Pose]) -> float:
    """Frames per second of the results: those of the recording, or the mean of live poses."""
    if not is_live(info) or len(recorded) < 2:
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
