"""The camera grid of one page, and how often and how large things are sent to a browser."""

import time
from dataclasses import replace

import viser

from services.viewer.controls import Controls
from services.viewer.frame_history import SolvedFrame
from services.viewer.markup import camera_grid, notice
from services.viewer.show import Show
from services.viewer.tiles import Look

_SMOOTH = 0.5
"""How much of a connection's last answer goes into what is known of it."""
_FEW_BYTES = 5_000
"""Updates of fewer bytes say nothing of how many get through."""


class SendPacing:
    """Says when something may be done again."""

    def __init__(self, period_s: float, rest: float = 0.0, line_rest: float = 1.0) -> None:
        """Afterwards it is left alone for rest times the processor time that making it took, so that others
        have theirs, and for line_rest times as long as it was on its way, so that others have their turn.
        """
        self._period_s, self._rest, self._line_rest = period_s, rest, line_rest
        self._again_s = 0.0

    def is_due(self) -> bool:
        """Whether it may be done."""
        return time.monotonic() >= self._again_s

    def done(self, began_s: float, made_s: float | None = None, cpu_s: float = 0.0) -> None:
        """It was done, beginning at a time of time.monotonic; made_s: when it began to be on its way.

        cpu_s: processor time that making it took, however long it had to wait for a processor.
        """
        now = time.monotonic()
        made_s = now if made_s is None else made_s
        rest_s = self._rest * cpu_s + self._line_rest * (now - made_s)
        self._again_s = max(began_s + self._period_s, now + rest_s)


class Connection:
    """How much a browser takes in, by how long its answers take."""

    def __init__(self) -> None:
        self._seconds_per_byte: float | None = None
        self._base_s = 0.0
        """What an answer takes whatever was sent: a browser that draws slowly is no slow connection."""

    def note(self, sent_bytes: int, answer_s: float) -> None:
        """An update of so many bytes was answered after so long."""
        if sent_bytes >= _FEW_BYTES:
            found = max(answer_s - self._base_s, 0.0) / sent_bytes
            known = found if self._seconds_per_byte is None else self._seconds_per_byte
            self._seconds_per_byte = known + _SMOOTH * (found - known)
        else:
            self._base_s += _SMOOTH * (answer_s - self._base_s)

    def seconds_for(self, n_bytes: int) -> float | None:
        """How long so many bytes will probably take; None where nothing is known yet."""
        return None if self._seconds_per_byte is None else n_bytes * self._seconds_per_byte


_PANEL_WIDTH_PX = 540
_WIDTHS = (1.0, 0.75, 0.5, 0.375)
"""Of tiles against those that are wanted: how small they get for connections that are slow."""
_FIRST_WIDTH = 0.5
_ANSWER_S = 0.25
"""How long a grid may be on its way to a browser."""


class CameraGrid:
    """One browser's; `draw` sends it, in the thread of its page."""

    def __init__(self, gui: viser.GuiApi, show: Show, pacing: SendPacing) -> None:
        self._show, self.pacing = show, pacing
        self.connection = Connection()
        self.sent_bytes = 0
        """Of the grid that was sent last."""
        self._whole_bytes, self._share = 0, 1.0
        self._drawn: tuple[int, Look] | None = None
        self._told = -1
        """What the user had asked for when it was drawn last."""
        self._html = self._panel(gui)

    def _panel(self, gui: viser.GuiApi) -> viser.GuiHtmlHandle | None:
        show = self._show
        if show.artist is None and not show.remark:
            return None
        panel = gui.add_panel()
        with panel.add_tab("Cameras", viser.Icon.CAMERA):
            html = gui.add_html(notice(show.remark) if show.remark else "")
            if show.artist is None:
                return None
        panel.dock_left()
        panel.set_width(_PANEL_WIDTH_PX)
        return html

    @property
    def frame(self) -> int | None:
        """The frame that it shows."""
        return None if self._drawn is None else self._drawn[0]

    def is_due(self, solved: SolvedFrame, controls: Controls) -> bool:
        """Whether it is to show something else, and its turn has come."""
        look = controls.look
        stands = self._drawn == (solved.frame, look)
        is_followed = controls.player.is_live and not self._show.history.is_over  # another frame comes soon
        if self._show.artist is None or self._html is None:
            return False
        if stands and (self._share == 1.0 or is_followed):
            return False
        is_asked_for = self._drawn is not None and self._told != controls.version
        return is_asked_for or self.pacing.is_due()

    def catch_up(self, solved: SolvedFrame, controls: Controls) -> None:
        """Decode pictures as far as a frame, so that drawing one that has come by then takes less."""
        if self._show.artist is not None:
            self._show.artist.catch_up(solved.frame, controls.look)

    def draw(self, solved: SolvedFrame, controls: Controls) -> bool:
        """Send it, if it is due; True when it was."""
        artist, look = self._show.artist, controls.look
        if artist is None or self._html is None or not self.is_due(solved, controls):
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
        self._html.content = camera_grid(
            tiles, self._show.camera_names, solved.frame, square=look.part is not None
        )
        self._drawn, self._told = (solved.frame, look), controls.version
        return True
