"""One show on one browser's page: decides what is sent, and when."""

import time
from dataclasses import dataclass

import cv2
import numpy as np
import viser

from services.mocap.take.quantities import STAGES
from services.mocap.verdict.verdict import frame_in_words
from services.viewer.controls import Controls
from services.viewer.curves import Curves
from services.viewer.frame_history import SolvedFrame
from services.viewer.grid import CameraGrid, SendPacing
from services.viewer.markup import lines_of, timeline, verdict_strip
from services.viewer.metrics import BEHIND
from services.viewer.show import Show
from services.viewer.stage import Stage


@dataclass(frozen=True)
class _Pace:
    """Shortest intervals between two updates, in seconds."""

    body_s: float
    grid_s: float
    frusta_s: float
    chart_s: float
    """From one chart to the next."""
    timeline_s: float
    rest: float
    """Pause after drawing the grid, as a multiple of the processor time of drawing. Most of that time decodes
    pictures between the shown ones, and a longer pause makes these more."""


_LIVE = _Pace(body_s=0.066, grid_s=0.3, frusta_s=1.0, chart_s=0.2, timeline_s=0.5, rest=4.0)
"""The same during tracking, which needs the processor."""
_FINISHED = _Pace(body_s=0.04, grid_s=0.1, frusta_s=0.5, chart_s=0.1, timeline_s=0.1, rest=2.0)
_OFTEN, _SELDOM, _RARELY = 0.5, 4.0, 8.0
"""Pause after sending the grid, charts or pictures in the room, as a multiple of the sending time."""
_TRAIL_S = 2.0
_AWAY_M, _BESIDE_RAD, _FOV_RAD, _WAYPOINTS = 2.4, 0.9, 0.9, 9
_ROAMING_M = 1.0
"""A browser's first viewpoint, and its distance while little of the motion is known."""
_FRUSTUM_PX = 160


class PageSession:
    """One show on one browser's page."""

    def __init__(self, client: viser.ClientHandle, show: Show) -> None:
        client.gui.reset()
        client.scene.reset()
        self._client, self._show = client, show
        self._stage = Stage(client.scene, show)
        if show.verdict is not None:
            client.gui.add_html(verdict_strip(show.verdict))
        pace = _LIVE if show.is_live else _FINISHED
        self._grid = CameraGrid(client.gui, show, SendPacing(pace.grid_s, pace.rest, _OFTEN))
        self._controls = Controls(client.gui, show)
        with client.gui.add_folder("Curves"):
            self._curves = Curves(client.gui, show.history)
        self._tick_s = pace.body_s
        self._curves_pacing = SendPacing(pace.chart_s, pace.rest, _SELDOM)
        self._frusta_pacing = SendPacing(pace.frusta_s, pace.rest, _RARELY)
        self._timeline_pacing = SendPacing(pace.timeline_s)
        self._answered: set[SendPacing] = set()
        self._sending: SendPacing | None = None
        """The large update that the browser has not answered yet."""
        self._began_s = self._made_s = self._cpu_s = 0.0
        self._hung_frame = self._timeline_frame = -1
        self._placed: SolvedFrame | None = None
        self._behind_s: float | None = None
        self._told, self._advanced_s = -1, time.monotonic()
        self._looked = False

    def update(self) -> bool:
        """Handle the user's actions and the passing of time, and send what has changed; True if anything was
        sent."""
        controls = self._controls
        controls.perform(self._tick_s)
        now = time.monotonic()
        frame = controls.player.advance(now - self._advanced_s)
        self._advanced_s = now
        solved = self._show.history.solved(frame)
        if solved is None:
            return self._say_missing(frame)
        self._began_s, self._sending = time.monotonic(), None
        sent = self._show_room(solved)
        cpu_s = time.thread_time()
        if controls.player.is_live and not self._show.history.is_over and self._grid.is_due(solved, controls):
            self._grid.catch_up(solved, controls)  # decoding takes a while: draw what is the newest then
            newest = self._show.history.solved(controls.player.advance(0.0))
            if newest is not None and newest is not solved:
                solved, sent = newest, self._show_room(newest) or sent
        # Only one large update at a time, so that the next body does not wait for all of them.
        if self._grid.draw(solved, controls):
            self._sending = self._grid.pacing
        elif self._curves_pacing.is_due() and self._curves.draw_next(solved.frame):
            self._sending = self._curves_pacing
        elif self._hang(solved):
            self._sending = self._frusta_pacing
        self._told, self._made_s, self._cpu_s = controls.version, time.monotonic(), time.thread_time() - cpu_s
        return sent or self._sending is not None

    @property
    def has_shown(self) -> bool:
        """Whether the browser has received the pictures (if there are any) and the curves."""
        wanted = {self._curves_pacing} | ({self._grid.pacing} if self._show.artist is not None else set())
        return wanted <= self._answered

    def _show_room(self, solved: SolvedFrame) -> bool:
        """Send the small updates at once, because drawing pictures takes time."""
        with self._client.atomic():
            sent = [self._show_body(solved), self._show_timeline(solved)]
        self._client.flush()
        return any(sent)

    def _say_missing(self, frame: int) -> bool:
        """Say that a frame is missing; the previous content stays."""
        words = f"{frame} {self._show.history.why_missing(frame)}"
        content = lines_of([("take", self._show.take), ("frame", words)])
        if content == self._controls.status.content:
            return False
        self._controls.status.content = content
        self._placed = None
        return True

    def note_answer(self) -> None:
        """Called when the browser has received what was sent."""
        if self._sending is not None:
            self._sending.done(self._began_s, self._made_s, self._cpu_s)
            self._answered.add(self._sending)
        if self._sending in (None, self._grid.pacing):  # the bytes of other updates are not counted
            sent_bytes = 0 if self._sending is None else self._grid.sent_bytes
            self._grid.connection.note(sent_bytes, time.monotonic() - self._made_s)
        if self._placed is not None and self._show.is_live and self._controls.player.is_live:
            self._behind_s = time.monotonic() - self._placed.arrived_s
            BEHIND.observe(self._behind_s)
            self._curves.note_lag(self._placed.frame, self._behind_s)

    def _show_body(self, solved: SolvedFrame) -> bool:
        shown = None if self._placed is None else self._placed.frame
        if solved.frame == shown and self._told == self._controls.version:
            return False
        self._placed = solved
        self._stage.place(solved)
        if not self._looked:
            self._look_at(solved)
        self._stage.show_cameras(self._controls.wants_frusta)
        self._controls.follow(solved.frame)
        self._controls.status.content = self._status(solved)
        known: list[SolvedFrame | None] = []
        if self._controls.wants_trails:
            start = max(solved.frame - round(_TRAIL_S * self._show.fps), 0)
            known = [self._show.history.solved(frame) for frame in range(start, solved.frame + 1)]
        self._stage.trail([found.pose for found in known if found is not None])
        return True

    def _show_timeline(self, solved: SolvedFrame) -> bool:
        is_asked_for = self._told != self._controls.version
        if solved.frame == self._timeline_frame or not (is_asked_for or self._timeline_pacing.is_due()):
            return False
        frames = self._show.history.extent
        at = (solved.frame - frames.start + 0.5) / len(frames)
        self._controls.timeline.content = timeline(self._show.history.overview(), at)
        self._timeline_frame = solved.frame
        self._timeline_pacing.done(self._began_s)
        return True

    def _look_at(self, solved: SolvedFrame) -> None:
        """Place the viewpoint in front of the middle of the known motion, slightly to the actor's side."""
        self._looked = True
        history = self._show.history
        start = history.frames.start
        some = np.linspace(start, history.newest or start, _WAYPOINTS).astype(int).tolist()
        known = [found.pose[:3] for found in map(history.solved, some) if found is not None]
        middle_m, heading = np.mean([solved.pose[:3], *known], axis=0), solved.pose[3] + _BESIDE_RAD
        reach_m = float(np.ptp([solved.pose[:3], *known], axis=0).max())
        away_m = _AWAY_M + (0.5 * reach_m if history.is_over else _ROAMING_M)
        eye_m = middle_m + np.array([away_m * np.cos(heading), away_m * np.sin(heading), 0.25 * away_m])
        self._client.camera.position = eye_m
        self._client.camera.look_at = middle_m - (0.0, 0.0, 0.1)
        self._client.camera.fov = _FOV_RAD

    def _status(self, solved: SolvedFrame) -> str:
        show, player = self._show, self._controls.player
        state = "live" if player.is_live else "playing" if player.is_playing else "standing"
        frames, extent = show.history.frames, show.history.extent
        of_all = f" of {frames[-1]}" if extent == frames else ""  # else nobody knows how many will come
        rows = [
            ("take", show.take),
            ("frame", f"{solved.frame}{of_all}, {solved.time_s:.2f} s, {state}"),
            ("energy", f"{solved.energy_px:.0f} px"),
        ]
        if not np.isnan(solved.of("confidence")).all():  # else nobody judged it
            rows.append(("verdict", frame_in_words(solved.distrusted.tolist())))
        seconds = solved.of("seconds")[STAGES.index("frame")]
        if np.isfinite(seconds) and seconds > 0:
            rows.append(("tracking", f"{1 / seconds:.1f} frames per second"))
        if player.is_live and self._behind_s is not None:
            rows.append(("page", f"{self._behind_s:.2f} s behind"))
        return lines_of(rows)

    def _hang(self, solved: SolvedFrame) -> bool:
        """Update the pictures in the room, preferably with those that the grid has decoded."""
        artist = self._show.artist
        frame = solved.frame if self._grid.frame is None else self._grid.frame
        if artist is None or not self._controls.wants_frusta or frame == self._hung_frame:
            return False
        if not self._frusta_pacing.is_due():
            return False
        pictures_rgb = []
        for c in range(len(self._show.camera_names)):
            picture = artist.ground(frame, c)
            size = _FRUSTUM_PX, max(1, round(_FRUSTUM_PX * picture.shape[0] / picture.shape[1]))
            small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            pictures_rgb.append(np.asarray(small[..., ::-1], np.uint8))
        with self._client.atomic():
            for c, picture in enumerate(pictures_rgb):
                self._stage.hang_picture(c, picture)
        self._hung_frame = frame
        return True
