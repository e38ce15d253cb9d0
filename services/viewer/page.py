"""The page of one browser: a thread that sends it what its user wants to see, as fast as it keeps up.

Never more than one update is on its way: the next one waits until the browser has answered the last. So a
slow browser gets fewer updates, but never old ones, and nothing piles up anywhere.
"""

import logging
import time
from collections.abc import Callable

import cv2
import numpy as np
import viser

from services.mocap.errors import UserError
from services.mocap.types import Bytes
from services.viewer.controls import Controls
from services.viewer.curves import Curves
from services.viewer.markup import camera_grid, lines_of, notice, timeline
from services.viewer.metrics import ANSWER, BEHIND
from services.viewer.reel import STAGES, Shot
from services.viewer.show import Show
from services.viewer.stage import Stage
from services.viewer.tiles import Look

log = logging.getLogger(__name__)

_TICK_S = 0.04
_GRID_S, _FRUSTA_S, _SLOW_S = 0.1, 0.5, 0.5
"""The camera grid, the pictures in the room, and curves with the timeline are sent no more often than so."""
_REST = 3.0
"""After drawing the grid nothing of it is drawn for so many times as long as that took."""
_ANSWER_S = 5.0
_TRAIL_S = 2.0
_GRID_WIDTH_PX, _PANEL_WIDTH_PX = 540, 400
_AWAY_M, _BESIDE_RAD, _FOV_RAD, _WAYPOINTS = 2.4, 0.9, 0.9, 9
_ROAMING_M = 1.0
"""Where a browser looks from at first, and how far it stands back while little is known of a motion."""
_FRUSTUM_PX = 160


class _Rhythm:
    """Says when something may be done again."""

    def __init__(self, period_s: float, rest: float = 0.0) -> None:
        self._period_s, self._rest = period_s, rest
        self._again_s = 0.0

    def is_due(self) -> bool:
        return time.monotonic() >= self._again_s

    def done(self, began_s: float) -> None:
        """It was done, beginning at a time of time.monotonic."""
        now = time.monotonic()
        self._again_s = max(began_s + self._period_s, now + self._rest * (now - began_s))


class Page:
    """One browser's page of whatever show there is."""

    def __init__(self, client: viser.ClientHandle, current: Callable[[], Show | None]) -> None:
        self._client, self._current = client, current
        self._programme: Programme | None = None
        self.is_open = True

    def run(self) -> None:
        """Send updates until the browser is gone or the page is closed."""
        shown: Show | None = None
        try:
            self._wait_for_show()
            while self.is_open:
                show = self._current()
                if show is not None and show is not shown:
                    shown = show
                    self._programme = Programme(self._client, show)
                if self._programme is not None and self._programme.update():
                    with ANSWER.time():
                        self._await_answer()
                    self._programme.note_answer()
        except _Gone:
            log.info("browser %d is gone", self._client.client_id)
        except UserError as error:
            self._client.gui.add_html(notice(str(error)))
            log.warning("%s", error)
        except Exception:  # of one page only
            log.exception("the page of browser %d has ended", self._client.client_id)

    def _wait_for_show(self) -> None:
        self._client.gui.set_panel_label("xormocap")
        self._client.gui.main_panel.dock_right()
        self._client.gui.main_panel.set_width(_PANEL_WIDTH_PX)
        if self._current() is None:
            self._client.gui.add_html(notice("Waiting for a take: nobody tracks one at the moment."))
        while self.is_open and self._current() is None:
            self._await_answer()
            time.sleep(_TICK_S)

    def _await_answer(self) -> None:
        """Wait until the browser has taken in all that was sent; raises _Gone where it has left."""
        while self.is_open:
            try:
                self._client.local_storage.get_item("seen", timeout=_ANSWER_S)
            except TimeoutError:
                continue
            except RuntimeError as error:
                if "disconnected" in str(error):
                    raise _Gone from None
            return


class _Gone(Exception):  # noqa: N818  (no error)
    """The browser has left."""


class Programme:
    """One show on one browser's page."""

    def __init__(self, client: viser.ClientHandle, show: Show) -> None:
        client.gui.reset()
        client.scene.reset()
        self._client, self._show = client, show
        self._stage = Stage(client.scene, show)
        self._grid = self._add_grid(client.gui)
        self._controls = Controls(client.gui, show)
        with client.gui.add_folder("Curves"):
            self._curves = Curves(client.gui, show.reel)
        self._grid_rhythm, self._slow_rhythm = _Rhythm(_GRID_S, _REST), _Rhythm(_SLOW_S)
        self._frusta_rhythm = _Rhythm(_FRUSTA_S)
        self._drawn: tuple[int, Look] | None = None
        self._slow_frame = self._hung_frame = -1
        self._placed: Shot | None = None
        self._behind_s: float | None = None
        self._told, self._advanced_s = -1, time.monotonic()
        self._looked = False

    def _add_grid(self, gui: viser.GuiApi) -> viser.GuiHtmlHandle | None:
        if self._show.artist is None and not self._show.remark:
            return None
        panel = gui.add_panel()
        with panel.add_tab("Cameras", viser.Icon.CAMERA):
            grid = gui.add_html(notice(self._show.remark) if self._show.remark else "")
            if self._show.artist is None:
                return None
        panel.dock_left()
        panel.set_width(_GRID_WIDTH_PX)
        return grid

    def update(self) -> bool:
        """Let the user's wishes and time go on, and send what differs; True when anything was sent."""
        controls = self._controls
        controls.perform(_TICK_S)
        now = time.monotonic()
        frame = controls.player.advance(now - self._advanced_s)
        self._advanced_s = now
        shot = self._show.reel.shot(frame)
        if shot is None:
            return False
        with self._client.atomic():
            sent = [self._show_body(shot), self._show_grid(shot), self._show_slow(shot), self._hang(shot)]
        self._told = controls.version
        return any(sent)

    def note_answer(self) -> None:
        """The browser has taken in what was sent."""
        if self._placed is not None and self._show.is_live and self._controls.player.is_live:
            self._behind_s = time.monotonic() - self._placed.arrived_s
            BEHIND.observe(self._behind_s)
            self._curves.note_lag(self._placed.frame, self._behind_s)

    def _show_body(self, shot: Shot) -> bool:
        if (
            self._placed is not None
            and shot.frame == self._placed.frame
            and self._told == self._controls.version
        ):
            return False
        self._placed = shot
        self._stage.place(shot)
        if not self._looked:
            self._look_at(shot)
        self._stage.show_cameras(self._controls.wants_frusta)
        self._controls.follow(shot.frame)
        self._controls.status.content = self._status(shot)
        frames = self._show.reel.frames
        self._controls.timeline.content = timeline(
            self._show.reel.overview(), (shot.frame - frames.start + 0.5) / len(frames)
        )
        self._stage.trail(self._trail(shot.frame) if self._controls.wants_trails else None)
        return True

    def _trail(self, frame: int) -> "np.typing.NDArray[np.float64]":
        span = round(_TRAIL_S * self._show.fps)
        shots = (self._show.reel.shot(f) for f in range(max(frame - span, 0), frame + 1))
        return np.array([shot.pose for shot in shots if shot is not None])

    def _look_at(self, shot: Shot) -> None:
        """Stand before the middle of what is known of the motion, a bit to the actor's side."""
        self._looked = True
        reel = self._show.reel
        some = np.linspace(reel.frames.start, reel.newest or reel.frames.start, _WAYPOINTS).astype(int)
        known = [found.pose[:3] for found in map(reel.shot, some.tolist()) if found is not None]
        middle_m, heading = np.mean([shot.pose[:3], *known], axis=0), shot.pose[3] + _BESIDE_RAD
        reach_m = float(np.ptp([shot.pose[:3], *known], axis=0).max())
        away_m = _AWAY_M + (0.5 * reach_m if reel.is_over else _ROAMING_M)
        eye_m = middle_m + np.array([away_m * np.cos(heading), away_m * np.sin(heading), 0.25 * away_m])
        self._client.camera.position = eye_m
        self._client.camera.look_at = middle_m - (0.0, 0.0, 0.1)
        self._client.camera.fov = _FOV_RAD

    def _status(self, shot: Shot) -> str:
        show, player = self._show, self._controls.player
        state = "live" if player.is_live else "playing" if player.is_playing else "standing"
        rows = [
            ("take", show.take),
            ("frame", f"{shot.frame} of {show.reel.frames[-1]}, {shot.time_s:.2f} s, {state}"),
            ("energy", f"{shot.energy_px:.0f} px"),
        ]
        seconds = shot.seconds[STAGES.index("frame")]
        if np.isfinite(seconds) and seconds > 0:
            rows.append(("tracking", f"{1 / seconds:.1f} frames per second"))
        if player.is_live and self._behind_s is not None:
            rows.append(("page", f"{self._behind_s:.2f} s behind"))
        return lines_of(rows)

    def _show_grid(self, shot: Shot) -> bool:
        artist, look = self._show.artist, self._controls.look
        if artist is None or self._grid is None or self._drawn == (shot.frame, look):
            return False
        is_asked_for = self._drawn is not None and self._drawn[1] != look
        if not is_asked_for and not self._grid_rhythm.is_due():
            return False
        began_s = time.monotonic()
        tiles = artist.draw(shot, look)
        self._grid.content = camera_grid(
            tiles, self._show.camera_names, shot.frame, square=look.part is not None
        )
        self._drawn = shot.frame, look
        self._grid_rhythm.done(began_s)
        return True

    def _show_slow(self, shot: Shot) -> bool:
        if shot.frame == self._slow_frame or not self._slow_rhythm.is_due():
            return False
        began_s = time.monotonic()
        self._curves.draw(shot.frame)
        self._slow_frame = shot.frame
        self._slow_rhythm.done(began_s)
        return True

    def _hang(self, shot: Shot) -> bool:
        """Bring the pictures in the room up to date."""
        artist = self._show.artist
        if artist is None or not self._controls.wants_frusta or shot.frame == self._hung_frame:
            return False
        if not self._frusta_rhythm.is_due():
            return False
        began_s = time.monotonic()
        for c in range(len(self._show.camera_names)):
            self._stage.hang_picture(c, _small(artist.ground(shot.frame, c)))
        self._hung_frame = shot.frame
        self._frusta_rhythm.done(began_s)
        return True


def _small(picture: Bytes) -> Bytes:
    """A picture (h, w, 3) for a frustum, in RGB."""
    height = max(1, round(_FRUSTUM_PX * picture.shape[0] / picture.shape[1]))
    small = cv2.resize(picture, (_FRUSTUM_PX, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small[..., ::-1], np.uint8)
