"""Live input: assembles shots from silhouettes; the newest complete shot is solved."""

import time
from collections import deque
from collections.abc import Callable
from math import ceil
from typing import Any

import numpy as np

from proto.messages import LivePace, LiveSilhouettes, LiveSources, Silhouettes
from services.coordinator.incoming import Frame, Incoming
from services.coordinator.live_shots import Pace, SourceReports, UnsolvedShots
from services.mocap.camera.rig import Rig
from services.mocap.take.live import LiveTake
from services.mocap.take.live_settings import fresh_s
from services.process import clock_name

_GAINING = 2.0
"""Least speed relative to the cameras while catching up. Shots are skipped only as needed for this speed:
after large motions between frames limbs become doubtful, and searching them takes longer than solving the
skipped shots."""
_LONGEST_STRIDE_S = 0.2
"""Shots that are solved one after the other lie at most this far apart, unless there is none between them: a
moving person may be lost in a longer step."""
_PRESENT_S, _PRESENT_SHOTS = 0.5, 3.0
"""A camera that has been silent for this time and this many shots is not waited for."""
_REMEMBERED = 300
"""Poses whose latency counts."""
_DRAIN_SHOTS = 3.0
_END_SHOTS = 4
"""Time from the end of tracking to the end of recordings, so that all recorders are told in advance."""


class LiveFrames(Incoming):
    """The newest complete shot: it has all present cameras, or is older than the grace time.

    now: a clock that only goes on, time.monotonic's unless told otherwise.
    """

    is_live = True

    def __init__(self, take: LiveTake, rig: Rig, now: Callable[[], float] = time.monotonic) -> None:
        super().__init__(rig)
        self._take, self._now = take, now
        self._names = take.camera_names
        self._shots, self._reports = UnsolvedShots(rig.n_cameras), SourceReports(rig.n_cameras)
        self._last_shot = self._highest = -1
        self._came_s = np.full(rig.n_cameras, -np.inf)
        self._pace = Pace(take.live.period_s)
        self._present_s = max(_PRESENT_S, _PRESENT_SHOTS * take.live.period_s)
        self._latencies_s = {which: deque[float](maxlen=_REMEMBERED) for which in ("", "settled_")}
        """Of first and of settled poses, by how their names in figures begin."""
        self._looked_s = self._returned_s = now()
        self._away_s, self._is_behind, self._is_solved_meanwhile = 0.0, False, False
        self._longest_stride = max(1, round(_LONGEST_STRIDE_S * take.settings.fps))

    def answer(self, sources: LiveSources) -> LivePace | None:
        """See Incoming.answer."""
        if sources.take != self._take.settings.name or max(sources.cameras) >= self._rig.n_cameras:
            self.dropped += 1
            return None
        now_s = self._now()
        self._reports.note(sources, now_s)
        if self._run and not self._pace.has_begun and self._reports.are_complete(now_s):
            self._pace.begin(self._reports.latest_s, now_s)
            # As if they had sent a picture, so that they are waited for.
            self._came_s[self._reports.cameras] = self._pace.due_s(0)
        shot, shot_s = self._pace.anchor
        return LivePace(
            take=sources.take,
            run=self._run if self._pace.has_begun else "",
            asked_s=sources.asked_s,
            answered_s=self._now(),
            clock=clock_name(),
            shot=shot,
            shot_s=shot_s,
            period_s=self._pace.period_s,
        )

    def add(self, message: Silhouettes | LiveSilhouettes) -> bool:
        """See Incoming.add."""
        if (
            not isinstance(message, LiveSilhouettes)
            or (message.take, message.run) != (self._take.settings.name, self._run)
            or len(message.times_s) != len(message.cameras)
            or not self._fits(message)
        ):
            self.dropped += 1
            return False
        now_s = self._now()
        self._came_s[message.cameras] = now_s
        self._pace.hear(message.shot, message.times_s)
        self._highest = max(self._highest, message.shot)
        if message.shot <= self._last_shot:
            self._shots.passed[message.cameras] += 1
            return False
        self._shots.add(message, now_s)
        return True

    def take_next(self) -> Frame | None:
        """See Incoming.take_next."""
        now_s = self._now()
        away_s, self._looked_s = now_s - self._looked_s, now_s
        if self._is_solved_meanwhile and away_s > self._take.live.period_s:
            self._returned_s, self._away_s = now_s, away_s
        self._is_solved_meanwhile = False  # between calls that find no frame no new frame is solved
        whole = self._whole(now_s)
        if not whole:
            return None
        if self._last_shot >= 0 and whole[-1] - self._last_shot > self._longest_stride:
            self._is_behind = True
        if self._is_behind:
            return self._hand_out(self._on_the_way(whole))
        period_s = self._take.live.period_s
        # Older shots have waited in queues during other work, and newer ones may follow at once.
        is_old = now_s - self._pace.due_s(whole[-1]) > fresh_s(self._take.live.fps)
        is_draining = now_s - self._returned_s < _DRAIN_SHOTS * period_s
        return None if is_old and is_draining else self._hand_out(whole[-1])

    def catch_up(self) -> None:
        """See Incoming.catch_up."""
        self._is_behind, self._away_s = True, 0.0
        # The search for the actor takes longer than solving, and would distort the stride.
        self._looked_s = self._now()

    def _on_the_way(self, whole: list[int]) -> int:
        """The complete shot to solve next: near enough to be tracked, far enough to reach the newest in
        time."""
        fps = self._take.settings.fps
        stride = min(max(1, ceil(_GAINING * self._away_s * fps)), self._longest_stride)
        near = [shot for shot in whole if shot <= self._last_shot + stride]
        chosen = near[-1] if near else whole[0]
        self._is_behind = chosen < whole[-1]
        return chosen

    def _whole(self, now_s: float) -> list[int]:
        """Shots with all present cameras, or with enough cameras after the grace time."""
        live = self._take.live
        there = set(np.flatnonzero(now_s - self._came_s < self._present_s).tolist())
        return self._shots.whole(there, live.least_cameras, now_s - live.grace_s)

    def _hand_out(self, number: int) -> Frame:
        shot = self._shots.take(number)
        self._last_shot, self._is_solved_meanwhile = number, True
        self.next_frame += 1
        seen = shot.seen(self._rig.n_cameras, self._rig.shape_px)
        shutter_s = float(np.median(list(shot.times_s.values())))
        absent = tuple(c for c in range(self._rig.n_cameras) if c not in shot.times_s)
        time_s = max(self._pace.since_first_s(shutter_s), 0.0)
        return Frame(seen, time_s, number, absent, shutter_s, self._is_behind)

    def waiting_for(self) -> list[int]:
        """See Incoming.waiting_for."""
        return np.flatnonzero(self._now() - self._came_s >= self._present_s).tolist()

    def note_latency(self, frame: Frame, *, is_settled: bool) -> float:
        """See Incoming.note_latency."""
        if frame.shutter_s is None:
            return 0.0
        latencies_s = self._latencies_s["settled_" if is_settled else ""]
        latencies_s.append(max(self._now() - frame.shutter_s, 0.0))
        return latencies_s[-1]

    @property
    def n_ready(self) -> int:
        """See Incoming.n_ready."""
        return len(self._whole(self._now()))

    @property
    def has_ended(self) -> bool:
        """See Incoming.has_ended: all sources are files that are over."""
        # Shots with too few cameras will get no more.
        is_more_to_solve = self._shots.have_enough(self._take.live.least_cameras)
        return self._reports.have_ended(self._now()) and not is_more_to_solve

    @property
    def end_shot(self) -> int:
        """See Incoming.end_shot: late enough that all recorders can still be told."""
        if not self._pace.has_begun:
            return 0
        if self.has_ended:
            return self._highest + 1
        due = round((self._now() - self._pace.due_s(0)) / self._pace.period_s)
        return max(due, 0) + _END_SHOTS

    def memory(self) -> dict[str, list[int]]:
        """See Incoming.memory."""
        return self._pace.as_lists()

    def recall(self, memory: dict[str, list[int]]) -> None:
        """See Incoming.recall."""
        self._pace.recall(memory, self._now())

    def figures(self) -> dict[str, Any]:
        """See Incoming.figures."""
        drops = {}
        told = self._reports.drops()
        for c, name in enumerate(self._names):
            missed, dropped, unsent = told.get(c, (0, 0, 0))
            drops[name] = [missed, dropped, int(self._shots.passed[c]) + unsent]
        latency_s: dict[str, float] = {}
        for which, latencies_s in self._latencies_s.items():
            if latencies_s:
                median_s, p95_s = np.percentile(latencies_s, [50, 95])
                latency_s |= {f"{which}median": float(median_s), f"{which}p95": float(p95_s)}
        absent = [self._names[c] for c in self.waiting_for()]
        return {"latency_s": latency_s, "drops": drops, "absent": absent}
