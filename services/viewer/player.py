"""Which frame a page shows, as time passes and its user steps, scrubs and plays."""

from dataclasses import dataclass
from typing import Literal

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
