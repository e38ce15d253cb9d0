"""The widgets of one browser, what its user has chosen with them, and which frame is shown.

A user's actions arrive on the page server's threads; they go into a queue, and the page's own thread handles
them.
"""

import queue
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import viser

from services.mocap.export.tiles import BEYOND_BGR, MISSED_BGR
from services.mocap.take.marks import PARTS, Part
from services.viewer.frame_history import FrameHistory
from services.viewer.markup import legend
from services.viewer.show import Show
from services.viewer.stage import DISTRUSTED_RGB, rgb_of
from services.viewer.tiles import Content, Look


@dataclass
class Player:
    """The state of a page's transport controls."""

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
            self.frame += steps
            if self.frame > newest:  # once more from the start, or on once there is more
                self.frame = self.history.frames.start if self.history.is_over else newest
        return self.frame

    def seek(self, frame: int) -> None:
        """Show a frame, and stay there or continue playing from there; leaves live mode."""
        self.frame, self.is_live, self._carry = frame, False, 0.0

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


_SPEEDS = {"¼×": 0.25, "½×": 0.5, "1×": 1.0, "2×": 2.0, "4×": 4.0}
_CONTENTS: tuple[Content, ...] = ("pictures", "silhouettes", "difference")
_PARTS: dict[str, Part | None] = {
    "whole pictures": None,
    **{f"{part.replace('_', ' ')}'s window": part for part in PARTS if part != "torso"},
}
_BACK, _PLAY, _PAUSE, _ON = "◂ frame", "play", "pause", "frame ▸"
_WIDE_TILE_PX, _TILE_PX = 640, 320
_SIDES = (
    (rgb_of("left_hand"), "left"),
    (rgb_of("right_hand"), "right"),
    (DISTRUSTED_RGB, "unreliable"),
)
_DIFFERENCES = (
    (MISSED_BGR[::-1], "actor without model"),
    (BEYOND_BGR[::-1], "model without actor"),
)

Action = Callable[[], None]


class Controls:
    """The controls of one browser; `perform` and everything that it reads belong to the page's thread."""

    def __init__(self, gui: viser.GuiApi, show: Show) -> None:
        self.show = show
        frames = show.history.extent
        newest = show.history.newest
        at = newest if show.is_live and newest is not None else frames.start
        self.player = Player(show.history, show.fps, at, is_live=show.is_live, is_playing=not show.is_live)
        self.version = 0
        """Incremented by every action of the user."""
        self._mail: queue.SimpleQueue[Action] = queue.SimpleQueue()
        self._gui = gui
        self.status = gui.add_html("")
        self.timeline = gui.add_html("")
        self._slider: Any = gui.add_slider("Frame", frames.start, max(frames[-1], frames.start + 1), 1, at)
        self._on_update(self._slider, self._seek)
        self._transport()
        self._looks()
        self._legend = gui.add_html(legend(_SIDES))

    def _seek(self, frame: float) -> None:
        newest, start = self.show.history.newest, self.show.history.frames.start
        self.player.seek(min(int(frame), start if newest is None else newest))

    def _on_update(self, handle: Any, act: Callable[[Any], None]) -> None:
        """Handle a user's action on a widget, but not changes by the page itself."""

        @handle.on_update  # type: ignore[untyped-decorator, unused-ignore]
        def _(event: Any) -> None:
            if event.client is not None:
                value = event.target.value
                self._mail.put(lambda: act(value))

    def _transport(self) -> None:
        buttons = self._gui.add_button_group("Play", (_BACK, _PLAY, _PAUSE, _ON))
        player = self.player
        does: dict[str, Action] = {
            _BACK: lambda: player.step(-1),
            _PLAY: lambda: player.play(True),
            _PAUSE: lambda: player.play(False),
            _ON: lambda: player.step(1),
        }
        buttons.on_click(lambda event: self._mail.put(does[event.target.value]))
        speed = self._gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1×")
        self._on_update(speed, lambda value: setattr(player, "speed", _SPEEDS[value]))
        self._live: Any = None
        if self.show.is_live:
            self._live = self._gui.add_checkbox("Live", True, hint="Follow the newest frame")
            self._on_update(self._live, lambda value: player.go_live() if value else player.play(False))

    def _looks(self) -> None:
        self.wants_trails, self.wants_frusta = False, True
        self._content: Content = "pictures" if self.show.has_pictures else "silhouettes"
        self._part: Part | None = None
        self._shown = list(range(len(self.show.camera_names)))
        if self.show.artist is not None:
            contents = tuple(name for name in _CONTENTS if self.show.has_pictures or name != "pictures")
            content = self._gui.add_dropdown("Cameras", contents)
            self._on_update(content, self._compare)
            part = self._gui.add_dropdown("of", tuple(_PARTS))
            self._on_update(part, lambda value: setattr(self, "_part", _PARTS[value]))
            with self._gui.add_folder("Which cameras", expand_by_default=False):
                for c, name in enumerate(self.show.camera_names):
                    self._on_update(self._gui.add_checkbox(name, True), partial(self._choose, c))
            frusta = self._gui.add_checkbox("Frusta", True, hint="The cameras in the room")
            self._on_update(frusta, lambda value: setattr(self, "wants_frusta", value))
        trails = self._gui.add_checkbox(
            "Trails", False, hint="Paths of hands and feet in the last two seconds"
        )
        self._on_update(trails, lambda value: setattr(self, "wants_trails", value))

    def _compare(self, content: Content) -> None:
        self._content = content
        self._legend.content = legend(_SIDES) + (legend(_DIFFERENCES) if content == "difference" else "")

    def _choose(self, camera: int, shown: bool) -> None:
        self._shown = sorted({*self._shown, camera} if shown else {*self._shown} - {camera})

    @property
    def look(self) -> Look:
        """The content of the camera grid."""
        width_px = _WIDE_TILE_PX if len(self._shown) == 1 else _TILE_PX
        return Look(self._content, tuple(self._shown), self._part, width_px)

    def perform(self, timeout_s: float) -> None:
        """Wait briefly for the user's actions, and handle all of them."""
        with suppress(queue.Empty):
            self._mail.get(timeout=timeout_s)()
            self.version += 1
            while True:
                self._mail.get_nowait()()

    def follow(self, frame: int) -> None:
        """Update the widgets to the shown frame."""
        last = self.show.history.extent[-1]
        if last > self._slider.max:
            self._slider.max = last
        self._slider.value = frame
        if self._live is not None:
            self._live.value = self.player.is_live
