"""Shots of live cameras: when each is due, what has come of it, and what segmentation reports of the
cameras."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from proto.messages import LiveSilhouettes, LiveSources
from proto.streams import FROM_LIVE_CAMERAS
from services.mocap.energy.bitplanes import TriPlanes, joined
from services.mocap.types import Ints
from services.process import clock_name

_LEAD_S = 1.0
"""Time from the first announcement of the pace to shot 0, so that all segmentations know it by then."""
_GAIN = 0.1
"""Share of a shot's time error that is corrected. Cameras' clocks differ by at most 0.1 %, so with a tenth
less than a hundredth of a period remains."""
_MEMORY_PARTS = 1_000_000
_COMPLETE_S = 10.0
"""How long to wait for other groups of cameras after the first."""
_KEPT_BYTES = 2**26
"""Limit of the silhouettes that are kept while a frame is solved; the oldest are dropped."""


class Pace:
    """When each shot is due: shot n at origin + n periods; the origin follows the median camera."""

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
        numbers = [self._shot, *(number for moment in moments for number in moment)]
        return {"pace": numbers, "clock": _clock_number()}

    def recall(self, lists: dict[str, list[int]], now_s: float) -> None:
        """Continue from another Pace's state, on the same machine; raises ValueError if it is invalid.

        If the machine has been started again since, its clock began anew: then the next shot is due soon. A
        shot that has come was due before now.
        """
        self._shot, s, parts, origin_s, origin_parts = lists.get("pace", [])
        self._shot_s, self._origin_s = s + parts / _MEMORY_PARTS, origin_s + origin_parts / _MEMORY_PARTS
        if lists.get("clock") != _clock_number() or self._shot_s > now_s + _LEAD_S:
            step_s = now_s + _LEAD_S - self._shot_s
            self._shot_s, self._origin_s = self._shot_s + step_s, self._origin_s + step_s
        self.has_begun = True


def _clock_number() -> list[int]:
    """What tells this machine's clock from that before it was started again."""
    return [zlib.crc32(clock_name().encode()) >> 1]


@dataclass
class ReceivedShot:
    """The received part of a shot."""

    arrived_s: float
    n_bytes: int = 0
    places: dict[int, tuple[TriPlanes, int]] = field(default_factory=dict)
    """Planes of each camera that has come, and its place in them."""
    times_s: dict[int, float] = field(default_factory=dict)
    """When each camera took its picture."""

    def seen(self, n_cameras: int, shape_px: tuple[int, int]) -> TriPlanes:
        """Planes (P, h, w) of all cameras; empty for missing ones."""
        nothing = TriPlanes.sure(np.zeros((1, *shape_px), np.uint8))
        return joined([self.places.get(c, (nothing, 0)) for c in range(n_cameras)])


class UnsolvedShots:
    """Unsolved shots, by number."""

    def __init__(self, n_cameras: int) -> None:
        self._shots: dict[int, ReceivedShot] = {}
        self.passed: Ints = np.zeros(n_cameras, np.int64)
        """(C,) number of pictures in skipped shots."""

    def add(self, message: LiveSilhouettes, now_s: float) -> None:
        """Add some cameras of a shot."""
        shot = self._shots.setdefault(message.shot, ReceivedShot(now_s))
        planes = TriPlanes.of_sent(message.planes, message.unsure, message.classes)
        shot.places |= {camera: (planes, k) for k, camera in enumerate(message.cameras)}
        shot.times_s.update(zip(message.cameras, message.times_s, strict=True))
        shot.n_bytes += planes.silhouettes.nbytes + planes.unsure.nbytes + planes.sent_classes.nbytes
        if sum(one.n_bytes for one in self._shots.values()) > _KEPT_BYTES:
            self._pass_over(min(self._shots))

    def _pass_over(self, number: int) -> None:
        self.passed[list(self._shots.pop(number).times_s)] += 1

    def whole(self, there: set[int], least_cameras: int, older_than_s: float) -> list[int]:
        """Shots, in order, with all present cameras, or with enough cameras if they arrived before a time."""
        return sorted(
            number
            for number, shot in self._shots.items()
            if len(shot.times_s) >= least_cameras
            and (there <= shot.times_s.keys() or shot.arrived_s <= older_than_s)
        )

    def take(self, number: int) -> ReceivedShot:
        """Return a shot; older ones are skipped."""
        taken = self._shots.pop(number)
        for older in [other for other in self._shots if other < number]:
            self._pass_over(older)
        return taken

    def have_enough(self, least_cameras: int) -> bool:
        """Whether any shot has at least this many cameras."""
        return any(len(shot.times_s) >= least_cameras for shot in self._shots.values())


class SourceReports:
    """The last report of every group of cameras."""

    def __init__(self, n_cameras: int) -> None:
        self._n_cameras = n_cameras
        self._reports: dict[tuple[int, ...], tuple[LiveSources, float]] = {}
        """By the group's cameras, and when it was heard."""
        self._first_s: float | None = None

    def note(self, message: LiveSources, now_s: float) -> None:
        """Store a group's report."""
        self._first_s = self._first_s or now_s
        self._reports[tuple(message.cameras)] = (message, now_s)

    @property
    def cameras(self) -> list[int]:
        """Cameras with a report."""
        return sorted({c for cameras in self._reports for c in cameras})

    def are_complete(self, now_s: float) -> bool:
        """Whether all cameras have reported, or the time limit has passed."""
        waited_s = now_s - (self._first_s or now_s)
        return len(self.cameras) == self._n_cameras or waited_s > _COMPLETE_S

    @property
    def latest_s(self) -> list[float]:
        """When the latest pictures of the cameras were taken."""
        return [taken_s for report, _ in self._reports.values() for taken_s in report.latest_s]

    def have_ended(self, now_s: float) -> bool:
        """Whether the sources of all groups that still report are files that have ended."""
        heard_after_s = now_s - FROM_LIVE_CAMERAS.silence_s
        here = [report for report, heard_s in self._reports.values() if heard_s > heard_after_s]
        return bool(here) and all(report.ended for report in here)

    def drops(self) -> dict[int, tuple[int, int, int]]:
        """Of each camera: pictures that did not come, that segmentation dropped, that were not sent."""
        return {
            c: (missed, dropped, report.unsent)
            for cameras, (report, _) in self._reports.items()
            for c, missed, dropped in zip(cameras, report.missed, report.dropped, strict=False)
        }
