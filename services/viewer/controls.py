"""What the user of one browser has chosen, and which frame is shown."""

import queue
from contextlib import suppress

from services.mocap.take.marks import Part
from services.viewer import actions
from services.viewer.actions import Action
from services.viewer.player import Player
from services.viewer.show import Show
from services.viewer.tiles import Content, Look

_WIDE_TILE_PX, _TILE_PX = 640, 320
_FIRST_CHARTS = ("Confidence", "Angle: knee flexion (degrees)")


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
            case actions.Step(frames=frames):
                player.step(frames)
            case actions.SeekDoubtful(way=way, by_stretch=by_stretch):
                player.seek_doubtful(way, by_stretch)
            case actions.Play(on=on):
                player.play(not player.is_playing if on is None else on)
            case actions.Live(on=on):
                player.go_live() if on else player.play(False)
            case actions.Speed(factor=factor):
                player.speed = factor
