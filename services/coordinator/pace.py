"""When each shot of live cameras is due: shots are evenly spaced and follow the cameras' clocks."""

from collections.abc import Sequence

import numpy as np

_LEAD_S = 1.0
"""Time from the first announcement of the pace to shot 0, so that all segmentations know it by then."""
_GAIN = 0.1
"""Share of a shot's time error that is corrected. Cameras' clocks differ by at most 0.1 %, so with a tenth
less than a hundredth of a period remains."""
_MEMORY_PARTS = 1_000_000


class Pace:
    """Shot n is due at origin + n periods; the origin follows the median camera."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self._shot, self._shot_s = 0, 0.0
        self._origin_s = 0.0
        self.has_begun = False

    def begin(self, latest_s: Sequence[float], now_s: float) -> None:
        """Set shot 0 to a near time, in step with the cameras' picture times, if there are any."""
        self._shot, self._shot_s = 0, now_s + _LEAD_S
        if latest_s:
            turns = np.exp(2j * np.pi * (np.array(latest_s) - now_s) / self.period_s)
            phase_s = float(np.angle(turns.mean())) / (2 * np.pi) * self.period_s
            self._shot_s = now_s + phase_s + np.ceil((_LEAD_S - phase_s) / self.period_s) * self.period_s
        self._shot_s = float(self._shot_s)
        self._origin_s, self.has_begun = self._shot_s, True

    @property
    def anchor(self) -> tuple[int, float]:
        """A shot, and when it is due."""
        return self._shot, self._shot_s

    def due_s(self, shot: int) -> float:
        """When a shot is due."""
        return self._shot_s + (shot - self._shot) * self.period_s

    def since_first_s(self, at_s: float) -> float:
        """A time, in seconds since shot 0 was due."""
        return at_s - self._origin_s

    def hear(self, shot: int, times_s: Sequence[float]) -> None:
        """Adjust to the times at which cameras took their pictures of a shot."""
        if shot <= self._shot:
            return
        off_s = float(np.median(np.array(times_s) - self.due_s(shot)))
        self._shot, self._shot_s = shot, self.due_s(shot) + _GAIN * off_s

    def as_lists(self) -> dict[str, list[int]]:
        """Its state, for `recall`: whole seconds and microseconds."""
        at_s = (self._shot_s, self._origin_s)
        moments = [divmod(round(one_s * _MEMORY_PARTS), _MEMORY_PARTS) for one_s in at_s]
        return {"pace": [self._shot, *(number for moment in moments for number in moment)]}

    def recall(self, lists: dict[str, list[int]]) -> None:
        """Continue from another Pace's state, on the same machine; raises ValueError if it is invalid."""
        self._shot, s, parts, origin_s, origin_parts = lists.get("pace", [])
        self._shot_s, self._origin_s = s + parts / _MEMORY_PARTS, origin_s + origin_parts / _MEMORY_PARTS
        self.has_begun = True
