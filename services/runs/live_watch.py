"""How live tracking is doing, as its coordinator tells whoever listens."""

import time
from dataclasses import dataclass
from pathlib import Path

import zmq

from proto.framing import MalformedMessage
from proto.link import Line
from proto.messages import Pose, Telemetry
from proto.sockets import receive, wait
from services.options import keys_of_client

_LOOK_S = 0.2
_RATE_S = 5.0
"""Over how long the rate of poses is told."""


@dataclass(frozen=True)
class LiveProgress:
    """How live tracking is doing."""

    poses: int
    poses_per_s: float
    energy_px: float
    told: Telemetry | None
    """What the coordinator said last."""


class LiveWatch:
    """Follows a coordinator's poses and telemetry."""

    def __init__(self, endpoint: str, keys: Path | None) -> None:
        """keys: the folder that xormocap keys made, where the coordinator wants some."""
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._line = Line(self._context, endpoint, "poses", keys_of_client(keys, "viewer"))
        self._came_s: list[float] = []
        self._end, self._energy_px = 0, 0.0
        self.told: Telemetry | None = None

    def look(self) -> LiveProgress:
        """Wait a moment for news; returns the state of things."""
        wait([self._line.socket], _LOOK_S)
        now_s = time.monotonic()
        try:
            while (message := receive(self._line.socket)) is not None:
                if isinstance(message, Pose):
                    self._came_s.append(now_s)
                    self._end, self._energy_px = max(self._end, message.frame + 1), message.energy_px
                elif isinstance(message, Telemetry):
                    self.told = message
        except MalformedMessage:
            pass  # progress only; the recorder counts
        self._line.tick()
        self._came_s = [came_s for came_s in self._came_s if now_s - came_s < _RATE_S]
        return LiveProgress(self._end, len(self._came_s) / _RATE_S, self._energy_px, self.told)

    def close(self) -> None:
        """Listen no longer."""
        self._line.close()
        self._context.term()


def in_words(progress: LiveProgress) -> str:
    """One line about how it is going."""
    told = progress.told
    if told is None:
        return "starting"
    if not progress.poses:
        what = "looking for somebody" if told.stage == "first frame" else told.stage
        return f"{what}; {_drops(told)}"
    words = f"{told.stage}  {progress.poses} poses, {progress.poses_per_s:.1f} a second"
    if told.latency_s:
        median_ms, p95_ms = 1000 * told.latency_s["median"], 1000 * told.latency_s["p95"]
        words += f"  latency {median_ms:.0f} ms (95 % below {p95_ms:.0f})"
    return f"{words}  {_drops(told)}"


def _drops(told: Telemetry) -> str:
    """What was dropped, of the camera that has it worst, and who is absent."""
    worst = [max(counts) for counts in zip(*told.drops.values(), strict=True)] or [0, 0, 0]
    absent = f"  absent: {', '.join(told.absent)}" if told.absent else ""
    return f"dropped by sources {worst[0]}, segmentation {worst[1]}, tracking {worst[2]}{absent}"
