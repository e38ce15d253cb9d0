"""What time it is where the coordinator runs, and which shot is due when, as its answers tell."""

from collections import deque

from proto.messages import LivePace

_SAMPLES = 32
"""Round trips of which the quickest counts; about a quarter of a minute."""


class CoordinatorClock:
    """Compares two monotonic clocks by round trips, as NTP does.

    The answer was given half-way through a round trip, give or take half of it; so of many round trips the
    quickest tells best. Where both sides read the same clock there is nothing to compare.
    """

    def __init__(self, own_clock: str) -> None:
        """own_clock: this machine's, by the name that a coordinator on it would give."""
        self._own_clock = own_clock
        self._trips: deque[tuple[float, float]] = deque(maxlen=_SAMPLES)
        self._ahead_s: float | None = None
        self._pace: LivePace | None = None

    def hear(self, answer: LivePace, now_s: float) -> None:
        """Take in an answer that came at a moment of this machine's clock."""
        if self._pace is not None and self._pace.clock != answer.clock:
            self._trips.clear()  # the coordinator's machine was started anew
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
        """The coordinator's run; empty as long as none has begun."""
        return "" if self._pace is None else self._pace.run

    @property
    def precision_s(self) -> float:
        """How far off the comparison may be at most."""
        return min(self._trips)[0] / 2 if self._trips else 0.0

    def there_s(self, here_s: float) -> float:
        """A moment of this machine's clock on the coordinator's."""
        return here_s + (self._ahead_s or 0.0)

    def here_s(self, there_s: float) -> float:
        """A moment of the coordinator's clock on this machine's."""
        return there_s - (self._ahead_s or 0.0)

    def shot_at(self, there_s: float) -> float:
        """Which shot is due at a moment of the coordinator's clock, with parts of it; needs a run."""
        if self._pace is None:
            raise ValueError("the pace is not known")
        return self._pace.shot + (there_s - self._pace.shot_s) / self._pace.period_s

    def due_s(self, shot: int) -> float:
        """When a shot is due, on the coordinator's clock; needs a run."""
        if self._pace is None:
            raise ValueError("the pace is not known")
        return self._pace.shot_s + (shot - self._pace.shot) * self._pace.period_s
