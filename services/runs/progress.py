"""How far a run is, as its coordinator tells whoever listens."""

import time
from collections import deque
from dataclasses import dataclass
from typing import Literal

from proto.keys import ClientKeys
from proto.messages import OPEN_END, Message, Pose, Telemetry
from services.listener import PosesListener
from services.mocap.result.words import rate_in_words

_RATE_S = 5.0
"""The time over which the rate of live frames is taken."""


@dataclass(frozen=True)
class Progress:
    """The progress of a run."""

    frames_done: int
    """In the present stage."""
    has_poses: bool
    """Whether any frame was solved."""
    frames_per_s: float
    """Rate of the last seconds; a sweep over solved frames does not count."""
    energy_px: float
    stage: str
    """What a run of a recorded take is doing, in words."""
    telemetry: Telemetry | None
    """The coordinator's last telemetry."""


class ProgressWatch(PosesListener):
    """Follows a coordinator's poses and telemetry."""

    def __init__(self, endpoint: str, keys: ClientKeys | None, first_frame: int) -> None:
        super().__init__(endpoint, keys)
        self._start = self._end = first_frame
        self._came_s: deque[float] = deque()
        self._energy_px = 0.0
        self._sweep: Literal["tracking back", "settling"] | None = None
        """What is done with all frames after the last one was solved."""
        self._swept = 0
        """How many frames it has done."""
        self.telemetry: Telemetry | None = None

    def take_in(self, message: Message) -> None:
        """Count frames; those that a coordinator finds again after a restart are no further ones."""
        if isinstance(message, Telemetry):
            self.telemetry = message
            if message.stage == "tracking back":
                self._sweep, self._swept = message.stage, message.end_frame - message.next_frame
        elif isinstance(message, Pose):
            if message.settled and (self.telemetry is None or self.telemetry.end_frame == OPEN_END):
                return  # live input has no sweeps: frames are settled while others are solved
            self._energy_px = message.energy_px
            if message.settled:
                self._sweep, self._swept = "settling", message.frame + 1 - self._start
            elif message.frame >= self._end:
                self._end = message.frame + 1
                self._came_s.append(time.monotonic())

    def progress(self, has_ended: bool) -> Progress:
        """The state of things; has_ended: whether the coordinator has."""
        now_s, came_s = time.monotonic(), self._came_s
        while came_s and now_s - came_s[0] > _RATE_S:
            came_s.popleft()
        lasted_s = now_s - came_s[0] if came_s else 0.0
        frames_per_s = (len(came_s) - 1) / lasted_s if lasted_s > 0 else 0.0
        done = self._end - self._start
        stage = "writing results" if has_ended else "tracking" if done else "finding the first pose"
        if self._sweep is not None and not has_ended:
            done, stage = self._swept, self._sweep
        return Progress(done, self._end > self._start, frames_per_s, self._energy_px, stage, self.telemetry)


def live_in_words(progress: Progress) -> str:
    """One line about how live tracking is going."""
    telemetry = progress.telemetry
    if telemetry is None:
        return "starting"
    worst = [max(counts) for counts in zip(*telemetry.drops.values(), strict=True)] or [0, 0, 0]
    dropped = f"dropped by sources {worst[0]}, segmentation {worst[1]}, tracking {worst[2]}"
    if telemetry.absent:
        dropped += f"  absent: {', '.join(telemetry.absent)}"
    if not progress.frames_done:
        what = "looking for a person" if telemetry.stage == "first frame" else telemetry.stage
        return f"{what}; {dropped}"
    words = f"{telemetry.stage}  {progress.frames_done} poses, {rate_in_words(progress.frames_per_s)}"
    if telemetry.latency_s:
        median_ms, p95_ms = 1000 * telemetry.latency_s["median"], 1000 * telemetry.latency_s["p95"]
        words += f"  latency {median_ms:.0f} ms (95 % below {p95_ms:.0f})"
        if "settled_median" in telemetry.latency_s:
            words += f", settled {1000 * telemetry.latency_s['settled_median']:.0f} ms"
    return f"{words}  {dropped}"
