"""Waits for a session's clients: at its beginning for workers and recorders, at its end for all frames to be
on the recorders' disks."""

import logging
import time
from collections.abc import Callable

from proto.messages import Recording
from services.coordinator.plan import Plan
from services.coordinator.recorders import LostFramesError
from services.coordinator.switchboard import Switchboard

log = logging.getLogger(__name__)

_ARRIVE_S = 60.0
"""How long it waits for the expected workers and recorders before it starts with fewer."""
_RETURN_S = 3.0
"""How long a coordinator that continues a run waits for workers to return."""
_CONFIRM_S = 20.0
"""How long recorders may be silent before confirming all frames."""


def await_clients(
    board: Switchboard, plan: Plan, workers: int, recorders: int, look: Callable[[], bool]
) -> Recording | None:
    """Wait for this many workers and recorders, but not for ever; returns what the recorders hold of this
    plan, if as many of them as are expected hold some of it.

    look: handles messages; returns False once a stop was requested.
    """

    def wait_until(condition: Callable[[], bool], patience_s: float) -> None:
        deadline_s = time.monotonic() + patience_s
        while not condition() and time.monotonic() < deadline_s:
            if not look():
                break

    dispatcher, reporting = board.dispatcher, board.recorders
    wait_until(lambda: reporting.n_reported >= recorders, _ARRIVE_S)
    held = reporting.held(plan.take.settings.name, plan.name, recorders)
    usable = held is not None and held.memory and (plan.actor is not None or held.actor.size)
    wait_until(lambda: dispatcher.n_workers >= workers, _RETURN_S if usable else _ARRIVE_S)
    if dispatcher.n_workers < workers or reporting.n_reported < recorders:
        found = (dispatcher.n_workers, workers, reporting.n_reported, recorders)
        log.warning("starting with %d of %d workers and %d of %d recorders", *found)
    return held if usable else None


def await_confirmation(board: Switchboard, end_frame: int, look: Callable[[], bool]) -> None:
    """Wait until all expected recorders have all frames before end_frame, but not for ever: only while one of
    them gets or confirms some now and then.

    look: handles messages. Raises LostFramesError if an expected recorder lacks frames in the end.
    """
    recorders = board.recorders
    while not recorders.have_all(end_frame, lambda: board.pump(0.0)):
        if time.monotonic() - recorders.heard_s > _CONFIRM_S:
            if recorders.n_lacking:
                raise LostFramesError(f"a recorder lacks {recorders.n_lacking} frames on disk")
            log.error("a recorder has not confirmed all frames")
            break
        look()
