"""Shots: when each is due by the coordinator's clock, and which pictures of several cameras make it up."""

import threading
import time
from collections import deque
from dataclasses import dataclass, field

from proto.messages import LivePace
from services.mocap.types import Bytes

_SAMPLES = 32
"""Number of round trips of which the fastest is used; about 15 seconds."""
_BACKLOG = 3
"""When so many whole shots wait, all but the newest are dropped."""
_KEPT = 8
_THERE_SHOTS, _THERE_S = 3.0, 0.3
"""A camera that gave no picture for the sum of both is not waited for."""


class CoordinatorClock:
    """Compares two monotonic clocks by round trips, as NTP does.

    The answer was given half-way through a round trip, with an error of at most half of it, so the fastest of
    many round trips is the most exact. If both sides read the same clock, no comparison is needed.
    """

    def __init__(self, own_clock: str) -> None:
        """own_clock: the name of this machine's clock."""
        self._own_clock = own_clock
        self._trips: deque[tuple[float, float]] = deque(maxlen=_SAMPLES)
        self._ahead_s: float | None = None
        self._pace: LivePace | None = None

    def hear(self, answer: LivePace, now_s: float) -> None:
        """Add an answer that arrived at a time of this machine's clock."""
        if self._pace is not None and self._pace.clock != answer.clock:
            self._trips.clear()  # the coordinator's machine was rebooted
        if answer.clock == self._own_clock:
            self._ahead_s = 0.0
        else:
            trip_s = now_s - answer.asked_s
            self._trips.append((trip_s, answer.answered_s - (answer.asked_s + now_s) / 2))
            self._ahead_s = min(self._trips)[1]
        self._pace = answer

    @property
    def is_known(self) -> bool:
        """Whether the clocks have been compared."""
        return self._ahead_s is not None

    @property
    def run(self) -> str:
        """The coordinator's run; empty before it begins."""
        return "" if self._pace is None else self._pace.run

    def there_s(self, here_s: float) -> float:
        """Convert a time of this machine's clock to the coordinator's."""
        return here_s + (self._ahead_s or 0.0)

    def here_s(self, there_s: float) -> float:
        """Convert a time of the coordinator's clock to this machine's."""
        return there_s - (self._ahead_s or 0.0)

    def shot_at(self, there_s: float) -> float:
        """The fractional number of the shot due at a time of the coordinator's clock; needs a run."""
        if self._pace is None:
            raise ValueError("the pace is not known")
        return self._pace.shot + (there_s - self._pace.shot_s) / self._pace.period_s

    def due_s(self, shot: int) -> float:
        """When a shot is due, on the coordinator's clock; needs a run."""
        if self._pace is None:
            raise ValueError("the pace is not known")
        return self._pace.shot_s + (shot - self._pace.shot) * self._pace.period_s


@dataclass(frozen=True, eq=False)
class Taken:
    """A camera's picture of a shot."""

    image: Bytes
    """BGR (H, W, 3)."""
    time_s: float
    """When it was taken, on the coordinator's clock."""


@dataclass(eq=False)
class Shot:
    """The pictures of a shot."""

    number: int
    arrived_s: float
    """When its first picture arrived, on this machine's clock."""
    taken: dict[int, Taken] = field(default_factory=dict)
    """By the camera's position in the group."""


class ShotCounter:
    """Assigns one camera's pictures to shots.

    Pictures are counted from the previous one while that agrees with the due times, so that a camera whose
    pictures are half-way between two shots does not jump back and forth.
    """

    def __init__(self, clock: CoordinatorClock, reach_s: float, period_s: float) -> None:
        self._clock, self._reach_s, self._period_s = clock, reach_s, period_s
        self._last: tuple[int, float] | None = None

    def number(self, there_s: float) -> int | None:
        """The shot of a picture taken at a time of the coordinator's clock; None if it belongs to none."""
        candidates = [round(self._clock.shot_at(there_s))]
        if self._last is not None:
            shot, last_s = self._last
            candidates.insert(0, shot + max(1, round((there_s - last_s) / self._period_s)))
        for shot in candidates:
            if abs(there_s - self._clock.due_s(shot)) <= self._reach_s:
                self._last = shot, there_s
                return shot
        return None


class Shots:
    """Collects pictures from many threads; returns shots to one."""

    def __init__(
        self, n_cameras: int, clock: CoordinatorClock, reach_s: float, period_s: float, grace_s: float
    ):
        """reach_s, period_s, grace_s: as in LiveSettings."""
        self._clock, self._period_s, self._grace_s = clock, period_s, grace_s
        self._changed = threading.Condition()
        self._counters = [ShotCounter(clock, reach_s, period_s) for _ in range(n_cameras)]
        self._shots: dict[int, Shot] = {}
        self._last_given = -1
        self._last_of: list[int | None] = [None] * n_cameras
        self._came_s = [float("-inf")] * n_cameras
        self.missed = [0] * n_cameras
        """Shots without a picture from a camera."""
        self.dropped = [0] * n_cameras
        """Dropped pictures of a camera."""
        self._passed_over = [0] * n_cameras
        self.latest_s: list[float | None] = [None] * n_cameras
        """When a camera took its latest picture, on this machine's clock."""

    def put(self, camera: int, image: Bytes, taken_s: float) -> int | None:
        """Add a picture taken at a time of this machine's clock; returns its shot, if any."""
        with self._changed:
            self.latest_s[camera] = taken_s
            self._came_s[camera] = time.monotonic()
            if not self._clock.run:
                return None
            there_s = self._clock.there_s(taken_s)
            number = self._counters[camera].number(there_s)
            last = self._last_of[camera]
            if number is None or number < 0 or (last is not None and number <= last):
                self.dropped[camera] += number is None or number >= 0
                return None
            lacking = number - (last + 1 if last is not None else 0)
            late = min(lacking, self._passed_over[camera])
            self._passed_over[camera] = 0
            self.dropped[camera] += late
            self.missed[camera] += lacking - late
            self._last_of[camera] = number
            if number <= self._last_given:
                self.dropped[camera] += 1
                return number
            shot = self._shots.setdefault(number, Shot(number, self._came_s[camera]))
            shot.taken[camera] = Taken(image, there_s)
            if len(self._shots) > _KEPT:
                self._drop(min(self._shots))
            self._changed.notify_all()
            return number

    def pass_over(self, camera: int, pictures: int) -> None:
        """Count pictures of a camera that existed but were not read in time as dropped, not as missed."""
        with self._changed:
            self._passed_over[camera] += pictures

    def take(self, timeout_s: float) -> Shot | None:
        """The next complete shot: the oldest, or the newest if too many wait."""
        with self._changed:
            deadline_s = time.monotonic() + timeout_s
            while not (whole := self._whole()):
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    return None
                self._changed.wait(min(left_s, self._grace_s / 2 or left_s))
            number = max(whole) if len(whole) >= _BACKLOG else min(whole)
            for older in [other for other in self._shots if other < number]:
                self._drop(older)
            self._last_given = number
            return self._shots.pop(number)

    @property
    def n_waiting(self) -> int:
        """Number of waiting shots."""
        return len(self._shots)

    def has_come(self, number: int) -> bool:
        """Whether all present cameras have a picture of a shot or of a later one."""
        absent = self.absent()
        there = [last for k, last in enumerate(self._last_of) if k not in absent]
        return all(last is not None and last >= number for last in there)

    def absent(self) -> list[int]:
        """Cameras without a current picture."""
        patience_s = _THERE_SHOTS * self._period_s + _THERE_S
        now_s = time.monotonic()
        return [k for k, came_s in enumerate(self._came_s) if now_s - came_s > patience_s]

    def _whole(self) -> list[int]:
        now_s, there = time.monotonic(), set(range(len(self._came_s))).difference(self.absent())
        return [
            number
            for number, shot in self._shots.items()
            if there <= shot.taken.keys() or now_s - shot.arrived_s >= self._grace_s
        ]

    def _drop(self, number: int) -> None:
        for camera in self._shots.pop(number).taken:
            self.dropped[camera] += 1
