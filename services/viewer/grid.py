"""The camera grid of one page, and how often and how large things are sent to a browser."""

import time
from dataclasses import replace

import numpy as np

from services.viewer.channel import Channel
from services.viewer.controls import Controls
from services.viewer.show import Show
from services.viewer.solved_frame import SolvedFrame
from services.viewer.tiles import Look, Tile

_SMOOTH = 0.5
"""Weight of the last answer in the running estimate of a connection."""
_FEW_BYTES = 5_000
"""Smaller updates say nothing about the data rate."""


class SendPacing:
    """Decides when a task is due again."""

    def __init__(self, period_s: float, rest: float = 0.0, line_rest: float = 1.0) -> None:
        """After each time it pauses for rest times the processor time it took, which leaves processor time to
        others, and for line_rest times its sending time, which leaves the connection to others.
        """
        self._period_s, self._rest, self._line_rest = period_s, rest, line_rest
        self._again_s = 0.0

    def is_due(self) -> bool:
        """Whether it is due."""
        return time.monotonic() >= self._again_s

    def done(self, began_s: float, made_s: float | None = None, cpu_s: float = 0.0) -> None:
        """Note that it was done, starting at a time of time.monotonic; made_s: when sending started.

        cpu_s: processor time of making it, without waiting for a processor.
        """
        now = time.monotonic()
        made_s = now if made_s is None else made_s
        rest_s = self._rest * cpu_s + self._line_rest * (now - made_s)
        self._again_s = max(began_s + self._period_s, now + rest_s)


class Connection:
    """The data rate of a browser, estimated from its answer times."""

    def __init__(self) -> None:
        self._seconds_per_byte: float | None = None
        self._base_s = 0.0
        """Time of an answer independent of its size: a browser that draws slowly is not a slow connection."""

    def note(self, sent_bytes: int, answer_s: float) -> None:
        """Note that an update of this size was answered after this time."""
        if sent_bytes >= _FEW_BYTES:
            found = max(answer_s - self._base_s, 0.0) / sent_bytes
            known = found if self._seconds_per_byte is None else self._seconds_per_byte
            self._seconds_per_byte = known + _SMOOTH * (found - known)
        else:
            self._base_s += _SMOOTH * (answer_s - self._base_s)

    def seconds_for(self, n_bytes: int) -> float | None:
        """Expected time to send this many bytes; None if nothing is known yet."""
        return None if self._seconds_per_byte is None else n_bytes * self._seconds_per_byte


_WIDTHS = (1.0, 0.75, 0.5, 0.375)
"""Smallest tile size for slow connections, relative to the wanted size."""
_FIRST_WIDTH = 0.5
_ANSWER_S = 0.25
"""How long sending a grid to a browser may take."""


class CameraGrid:
    """One browser's; `draw` sends it, in the thread of its page."""

    def __init__(self, channel: Channel, show: Show, pacing: SendPacing) -> None:
        self._channel, self._show, self.pacing = channel, show, pacing
        self.connection = Connection()
        self.sent_bytes = 0
        """Of the last sent grid, all its tiles together."""
        self._whole_bytes, self._share = 0, 1.0
        self._drawn: tuple[int, Look] | None = None
        self._told = -1
        """The user's choices when it was last drawn."""

    @property
    def frame(self) -> int | None:
        """The frame that it shows."""
        return None if self._drawn is None else self._drawn[0]

    def is_due(self, solved: SolvedFrame, controls: Controls) -> bool:
        """Whether its content has changed and it is due."""
        look = controls.look
        stands = self._drawn == (solved.frame, look)
        is_followed = controls.player.is_live and not self._show.history.is_over  # another frame comes soon
        if self._show.artist is None:
            return False
        if stands and (self._share == 1.0 or is_followed):
            return False
        is_asked_for = self._drawn is not None and self._told != controls.version
        return is_asked_for or self.pacing.is_due()

    def catch_up(self, solved: SolvedFrame, controls: Controls) -> None:
        """Decode pictures up to a frame, so that drawing a later frame takes less time."""
        if self._show.artist is not None:
            self._show.artist.catch_up(solved.frame, controls.look)

    def draw(self, solved: SolvedFrame, controls: Controls) -> bool:
        """Send it, if it is due; True when it was."""
        artist, look = self._show.artist, controls.look
        if artist is None or not self.is_due(solved, controls):
            return False
        stands = self._drawn == (solved.frame, look)
        likely_s = self.connection.seconds_for(self._whole_bytes)
        if stands:  # it is shown whole, however long that takes
            self._share = 1.0
        elif likely_s is None:
            self._share = _FIRST_WIDTH
        else:  # smaller where the browser would be long in taking it
            self._share = next((w for w in _WIDTHS if w * w * likely_s <= _ANSWER_S), _WIDTHS[-1])
        tiles = artist.draw(solved, replace(look, tile_width_px=round(self._share * look.tile_width_px)))
        self.sent_bytes = sum(len(tile.jpeg) for tile in tiles)
        self._whole_bytes = round(self.sent_bytes / self._share**2)
        self._channel.send(
            "grid",
            [tile.jpeg for tile in tiles],
            frame=solved.frame,
            tiles=[self._words(tile, solved) for tile in tiles],
        )
        self._drawn, self._told = (solved.frame, look), controls.version
        return True

    def _words(self, tile: Tile, solved: SolvedFrame) -> dict[str, object]:
        """What stands on a tile."""
        iou = solved.iou[tile.camera] if tile.camera < len(solved.iou) else np.nan
        return {
            "camera": tile.camera,
            "name": self._show.camera_names[tile.camera],
            "differing_px": tile.differing_px,
            "missing": tile.missing,
            "iou": float(iou) if np.isfinite(iou) else None,
        }
