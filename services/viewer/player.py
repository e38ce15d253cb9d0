"""Which frame a page shows: the newest, one that plays, or one that stands."""

from dataclasses import dataclass

from services.viewer.frame_history import FrameHistory


@dataclass
class Player:
    """The state of a page's transport controls."""

    history: FrameHistory
    fps: float
    """Of the recording."""
    frame: int
    """The frame that is shown."""
    is_live: bool
    """Follows the newest frame."""
    is_playing: bool = False
    speed: float = 1.0
    """Times the recording's own; playing only."""
    _carry: float = 0.0
    """Part of a frame that time has already gone on by."""

    def advance(self, elapsed_s: float) -> int:
        """Let time go on; returns the frame to show."""
        newest = self.history.newest
        if newest is None:
            return self.frame
        if self.is_live:
            self.frame = newest
        elif self.is_playing:
            self._carry += elapsed_s * self.fps * self.speed
            steps, self._carry = int(self._carry), self._carry % 1.0
            self.frame = self._within(self.frame + steps, newest)
        return self.frame

    def _within(self, frame: int, newest: int) -> int:
        """The frame to play: from the start again where a take that is over ends, else held at the newest."""
        if frame <= newest:
            return frame
        return self.history.frames.start if self.history.is_over else newest

    def seek(self, frame: int) -> None:
        """Show a frame, and stand there or go on playing from there; no longer live."""
        self.frame, self.is_live, self._carry = frame, False, 0.0

    def play(self, playing: bool) -> None:
        """Play from the frame that is shown, or stand there; no longer live."""
        self.is_playing, self.is_live, self._carry = playing, False, 0.0

    def go_live(self) -> None:
        """Follow the newest frame from now on."""
        self.is_live, self.is_playing = True, False

    def step(self, frames: int) -> None:
        """Stand so many frames later, or earlier."""
        newest = self.history.newest
        if newest is not None:
            self.play(False)
            self.frame = min(max(self.frame + frames, self.history.frames.start), newest)
