"""Waits for the next frame to solve."""

import logging
from collections.abc import Callable

from services.coordinator.incoming import Frame
from services.coordinator.plan import Plan
from services.coordinator.switchboard import Switchboard
from services.health import beat
from services.process import STOP_CHECK_S, StopRequest

log = logging.getLogger(__name__)

_UNRECORDED_FRAMES = 2000
"""How far the fit may be ahead of the expected recorders."""
_SAY_WAITING_EVERY = 25
"""Attempts without a frame after which the log says what is missing."""


class FrameInput:
    """Hands out frame after frame; until the next one is there, it handles messages."""

    def __init__(
        self, plan: Plan, board: Switchboard, stop: StopRequest, work_meanwhile: Callable[[], bool]
    ) -> None:
        """work_meanwhile: does a step of other work while there is no frame; False if there is none."""
        self._camera_names, self._board, self._incoming = plan.take.camera_names, board, board.incoming
        self._stop, self._work_meanwhile = stop, work_meanwhile

    def next(self) -> Frame | None:
        """The next frame; None if a stop was requested or live input has ended."""
        looks = 0
        if self._incoming.is_live:
            self._board.pump(0.0)  # messages that have arrived meanwhile are newer
        while not self._stop and not self._incoming.has_ended:
            beat()
            found = self._incoming.take_next() if self._is_kept_up_with() else None
            credit = self._incoming.credit()
            if credit is not None:
                self._board.give_credit(credit)
            if found is not None:
                return found
            if self._work_meanwhile():
                self._board.pump(0.0)
                continue
            self._board.pump(STOP_CHECK_S)
            looks += 1
            if looks % _SAY_WAITING_EVERY == 0:
                self._say_what_is_missing()
        return None

    def _is_kept_up_with(self) -> bool:
        """Whether the expected recorders keep up."""
        return self._board.recorders.n_lacking < _UNRECORDED_FRAMES

    def _say_what_is_missing(self) -> None:
        missing = [self._camera_names[c] for c in self._incoming.waiting_for()]
        if missing:
            log.info("frame %d still lacks %s", self._incoming.next_frame, ", ".join(missing))
        elif not self._is_kept_up_with():
            log.warning("waiting for recorders, which lack %d frames", self._board.recorders.n_lacking)
