"""The deadline of limb tasks: a moving estimate, like TCP's estimate of the round-trip time."""

FIRST_DEADLINE_S = 20.0
"""Deadline before any task was timed: a worker may have to build its meshes first."""
DEADLINE_FLOOR_S = 0.5
"""Least time beyond the usual duration; machines are slow now and then."""
DEADLINE_FACTOR = 4.0
"""Number of mean deviations added to it."""
_NEW_SHARE, _NEW_DEVIATION_SHARE = 0.125, 0.25


class Deadline:
    """Estimates the usual duration of tasks and its deviation, which vary with the limb and the machine's
    load."""

    def __init__(self) -> None:
        self._usual_s: float | None = None
        self._deviation_s = 0.0

    @property
    def seconds(self) -> float:
        """Time after which a task is late."""
        if self._usual_s is None:
            return FIRST_DEADLINE_S
        return DEADLINE_FLOOR_S + self._usual_s + DEADLINE_FACTOR * self._deviation_s

    def note(self, seconds: float) -> None:
        """Note a task's duration since it was given to a worker."""
        if self._usual_s is None:
            self._usual_s, self._deviation_s = seconds, seconds / 2
            return
        off_s = seconds - self._usual_s
        self._usual_s += _NEW_SHARE * off_s
        self._deviation_s += _NEW_DEVIATION_SHARE * (abs(off_s) - self._deviation_s)
