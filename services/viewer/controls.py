"""What the user of one browser has chosen, and which frame is shown as time passes."""

import queue
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from services.mocap.take.marks import Part
from services.viewer import actions
from services.viewer.actions import Action
from services.viewer.frame_history import FrameHistory
from services.viewer.show import Show
from services.viewer.tiles import Content, Look

_WIDE_TILE_PX, _TILE_PX = 640, 320
_FIRST_CHARTS = ("Confidence", "Angle: knee flexion (degrees)")


@dataclass
class Player:
    """Which frame a page shows, as its user steps, scrubs and plays."""

    history: FrameHistory
    fps: float
    """Of the recording."""
    frame: int
    """The frame that is shown."""
    is_live: bool
    """Whether the page follows the newest frame."""
    is_playing: bool = False
    speed: float = 1.0
    """Speed relative to the recording, while playing."""
    _carry: float = 0.0
    """Fraction of a frame that has already elapsed."""

    def advance(self, elapsed_s: float) -> int:
        """Advance the time; returns the frame to show."""
        newest = self.history.newest
        if newest is None:
            return self.frame
        if self.is_live:
            self.frame = newest
        elif self.is_playing:
            self._carry += elapsed_s * self.fps * self.speed
            steps, self._carry = int(self._carry), self._carry % 1.0
            self.frame = max(self.frame + steps, self.history.frames.start)
            if self.frame > newest:  # once more from the start, or on once there is more
                self.frame = self.history.frames.start if self.history.is_over else newest
        return self.frame

    def seek(self, frame: int) -> None:
        """Show the solved frame next to this one, and stay there or continue playing; leaves live mode."""
        start, newest = self.history.frames.start, self.history.newest
        self.frame = max(start, min(frame, start if newest is None else newest))
        self.is_live, self._carry = False, 0.0

    def play(self, playing: bool) -> None:
        """Play from the shown frame, or stay there; leaves live mode."""
        self.is_playing, self.is_live, self._carry = playing, False, 0.0

    def go_live(self) -> None:
        """Follow the newest frame (live mode)."""
        self.is_live, self.is_playing = True, False

    def step(self, frames: int) -> None:
        """Stay at a frame this many frames later or earlier."""
        newest = self.history.newest
        if newest is not None:
            self.play(False)
            self.frame = min(max(self.frame + frames, self.history.frames.start), newest)

    def seek_doubtful(self, way: Literal[-1, 1], by_stretch: bool) -> None:
        """Stay at the next (1) or previous (-1) doubtful frame, if there is one.

        by_stretch: at the first frame of another stretch of doubtful frames.
        """
        found = self.history.doubtful_beside(self.frame, way, by_stretch)
        if found is not None:
            self.play(False)
            self.frame = found


class Controls:
    """The choices of one browser; for the page's thread only."""

    def __init__(self, user_actions: "queue.Queue[Action]", show: Show) -> None:
        """user_actions: what the user does, as it arrives."""
        history = show.history
        at = history.newest if show.is_live and history.newest is not None else history.frames.start
        self.player = Player(history, show.fps, at, is_live=show.is_live, is_playing=not show.is_live)
        self.version = 0
        """Incremented by every action of the user."""
        self.room = actions.Room(do="room", frusta=True, trails=False, follow=False)
        self.charts: tuple[str, ...] = _FIRST_CHARTS
        self.framing: actions.Frame | None = actions.Frame(do="frame", what="all")
        """Where the viewpoint is to go; None once it is there."""
        self._actions, self._n_cameras = user_actions, len(show.camera_names)
        self._content: Content = "pictures" if show.has_pictures else "silhouettes"
        self._part: Part | None = None
        self._cameras = tuple(range(self._n_cameras))
        self._large: int | None = None

    @property
    def look(self) -> Look:
        """The content of the camera grid."""
        cameras = self._cameras if self._large is None else (self._large,)
        return Look(self._content, cameras, self._part, _WIDE_TILE_PX if len(cameras) == 1 else _TILE_PX)

    def perform(self, timeout_s: float) -> None:
        """Wait briefly for the user's actions, and do all of them."""
        with suppress(queue.Empty):
            self._do(self._actions.get(timeout=timeout_s))
            while True:
                self._do(self._actions.get_nowait())

    def _do(self, action: Action) -> None:
        self.version += 1
        match action:
            case actions.Enlarge(camera=camera):
                self._large = camera if camera in range(self._n_cameras) else None
            case actions.ShowTiles():
                self._content, self._part = action.content, action.part
                self._cameras = tuple(c for c in range(self._n_cameras) if c in action.cameras)
            case actions.Room():
                self.room = action
            case actions.Frame():
                self.framing = action
            case actions.Choose(titles=titles):
                self.charts = titles
            case _:
                self._move(action)

    def _move(self, action: Action) -> None:
        player = self.player
        match action:
            case actions.Seek(frame=frame):
                player.seek(frame)
            case actions.StepBy(frames=frames):
                player.step(frames)
            case actions.SeekDoubtful(way=way, by_stretch=by_stretch):
                player.seek_doubtful(way, by_stretch)
            case actions.Play(on=on):
                player.play(not player.is_playing if on is None else on)
            case actions.Live(on=on):
                player.go_live() if on else player.play(False)
            case actions.Speed(factor=factor):
                player.speed = factor
