"""One show on one browser's page: decides what is sent, and when."""

import time
from dataclasses import dataclass

import cv2
import numpy as np
import viser

from services.viewer.channel import Channel
from services.viewer.charts import Charts
from services.viewer.controls import Controls
from services.viewer.grid import CameraGrid, SendPacing
from services.viewer.metrics import BEHIND
from services.viewer.page_words import chart_message, frame_words, show_words, timeline_message, why_missing
from services.viewer.scene import Scene3D
from services.viewer.show import Show
from services.viewer.solved_frame import SolvedFrame
from services.viewer.viewpoint import ViewpointControl


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


_LIVE = _Pace(body_s=0.066, grid_s=0.3, frusta_s=1.0, chart_s=0.4, timeline_s=0.5, rest=4.0)
"""The same during tracking, which needs the processor."""
_FINISHED = _Pace(body_s=0.04, grid_s=0.1, frusta_s=0.5, chart_s=0.1, timeline_s=0.1, rest=2.0)
_OFTEN, _SELDOM, _RARELY = 0.5, 4.0, 8.0
"""Pause after sending the grid, charts or pictures in the room, as a multiple of the sending time."""
_TRAIL_S = 2.0
_FRUSTUM_PX = 160


class PageSession:
    """One show on one browser's page."""

    def __init__(self, client: viser.ClientHandle, channel: Channel, show: Show) -> None:
        client.scene.reset()
        self._client, self._channel, self._show = client, channel, show
        self._scene = Scene3D(client.scene, show)
        self._viewpoint = ViewpointControl(client.camera, show)
        self._charts = Charts(show.history, show.body)
        self._controls = Controls(channel.actions, show)
        pace = _LIVE if show.is_live else _FINISHED
        self._grid = CameraGrid(channel, show, SendPacing(pace.grid_s, pace.rest, _OFTEN))
        self._tick_s = pace.body_s
        self._charts_pacing = SendPacing(pace.chart_s, pace.rest, _SELDOM)
        self._frusta_pacing = SendPacing(pace.frusta_s, pace.rest, _RARELY)
        self._timeline_pacing = SendPacing(pace.timeline_s)
        self._sending: SendPacing | None = None
        """The large update that the browser has not answered yet."""
        self._last_large: SendPacing | None = None
        self._began_s = self._made_s = self._cpu_s = 0.0
        self._frusta_frame = self._timeline_version = -1
        self._charts_drawn: dict[str, int] = {}
        """By title: the version of the history of which each chart was last drawn."""
        self.has_shown = False
        """Whether the browser has received a curve, which comes after the pictures if there are any."""
        self._placed: SolvedFrame | None = None
        self._missing = -1
        self._behind_s: float | None = None
        self._told, self._advanced_s = -1, time.monotonic()
        channel.send("show", **show_words(show, self._charts.titles, self._controls))

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
        self._sending = self._send_large(solved)
        self._told, self._made_s, self._cpu_s = controls.version, time.monotonic(), time.thread_time() - cpu_s
        return sent or self._sending is not None

    def _send_large(self, solved: SolvedFrame) -> SendPacing | None:
        """Send the grid, a chart or the pictures in the room; returns the pacing of what was sent.

        The grid goes first, except directly after a grid: a slow browser is always due another one.
        """
        is_grids_turn = self._last_large is not self._grid.pacing
        if is_grids_turn and self._grid.draw(solved, self._controls):
            found = self._grid.pacing
        elif self._charts_pacing.is_due() and self._draw_chart():
            found = self._charts_pacing
        elif self._show_frusta_pictures(solved):
            found = self._frusta_pacing
        elif self._grid.draw(solved, self._controls):
            found = self._grid.pacing
        else:
            return None
        self._last_large = found
        return found

    def _show_room(self, solved: SolvedFrame) -> bool:
        """Send the small updates at once, because drawing pictures takes time."""
        with self._client.atomic():
            has_moved = self._show_body(solved)
        self._client.flush()
        return self._show_timeline() or has_moved

    def _say_missing(self, frame: int) -> bool:
        """Say that a frame is missing; the previous content stays."""
        if self._missing == frame and self._told == self._controls.version:
            return False
        self._channel.send("missing", frame=frame, words=why_missing(frame, self._show.history))
        self._placed, self._missing, self._told = None, frame, self._controls.version
        return True

    def note_answer(self) -> None:
        """Called when the browser has received what was sent."""
        if self._sending is not None:
            self._sending.done(self._began_s, self._made_s, self._cpu_s)
            self.has_shown |= self._sending is self._charts_pacing
        if self._sending in (None, self._grid.pacing):  # the bytes of other updates are not counted
            sent_bytes = 0 if self._sending is None else self._grid.sent_bytes
            self._grid.connection.note(sent_bytes, time.monotonic() - self._made_s)
        if self._placed is not None and self._show.is_live and self._controls.player.is_live:
            self._behind_s = time.monotonic() - self._placed.arrived_s
            BEHIND.observe(self._behind_s)
            self._charts.note_delay(self._placed.frame, self._behind_s)

    def _show_body(self, solved: SolvedFrame) -> bool:
        shown, controls = None if self._placed is None else self._placed.frame, self._controls
        self._viewpoint.refit()
        if solved.frame == shown and self._told == controls.version:
            return False
        self._placed, self._missing = solved, -1
        self._scene.place(solved)
        self._viewpoint.follow(solved, controls.room.follow)
        if controls.framing is not None:
            is_all = controls.framing.what == "all"
            (self._viewpoint.frame_all if is_all else self._viewpoint.frame_actor)(solved)
            controls.framing = None
        self._scene.show_cameras(controls.room.frusta)
        behind_s = self._behind_s if controls.player.is_live else None
        self._channel.send("frame", **frame_words(solved, controls.player, behind_s))
        known: list[SolvedFrame | None] = []
        if controls.room.trails:
            start = max(solved.frame - round(_TRAIL_S * self._show.fps), 0)
            known = [self._show.history.solved(frame) for frame in range(start, solved.frame + 1)]
        self._scene.trail([found.pose for found in known if found is not None])
        return True

    def _show_timeline(self) -> bool:
        version = self._show.history.version
        if version == self._timeline_version or not self._timeline_pacing.is_due():
            return False
        blobs, fields = timeline_message(self._show.history)
        self._channel.send("timeline", blobs, **fields)
        self._timeline_version = version
        self._timeline_pacing.done(time.monotonic())
        return True

    def _draw_chart(self) -> bool:
        """Send the next chart that is not up to date; False if there is none.

        One at a time, because the next body waits while a chart is being sent.
        """
        version = self._show.history.version
        self._charts_drawn = {
            title: v for title, v in self._charts_drawn.items() if title in self._controls.charts
        }
        late = [title for title in self._controls.charts if self._charts_drawn.get(title) != version]
        if not late:
            return False
        title = min(late, key=lambda title: self._charts_drawn.get(title, -1))
        self._charts_drawn[title] = version
        drawn = self._charts.draw(title)
        if drawn is not None:
            blobs, fields = chart_message(drawn)
            self._channel.send("chart", blobs, **fields)
        return drawn is not None

    def _show_frusta_pictures(self, solved: SolvedFrame) -> bool:
        """Update the pictures in the room, preferably with those that the grid has decoded."""
        artist = self._show.artist
        frame = solved.frame if self._grid.frame is None else self._grid.frame
        if artist is None or not self._controls.room.frusta or frame == self._frusta_frame:
            return False
        if not self._frusta_pacing.is_due():
            return False
        pictures_rgb = []
        for c in range(len(self._show.camera_names)):
            picture = artist.background(frame, c)
            size = _FRUSTUM_PX, max(1, round(_FRUSTUM_PX * picture.shape[0] / picture.shape[1]))
            small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            pictures_rgb.append(np.asarray(small[..., ::-1], np.uint8))
        with self._client.atomic():
            for c, picture in enumerate(pictures_rgb):
                self._scene.show_picture(c, picture)
        self._frusta_frame = frame
        return True
