"""Which frames to ask a coordinator for that did not come, and which to let be.

It keeps the latest frames only, and one that was started again has none from before. What it does not send
after a few requests it has not got, nor anything before that.
"""

import math
import threading

_AGAIN_S = 0.4
_MOST = 3
"""Requests for the same frames, before they are let be."""


class RetryRequests:
    """Remembers what was asked for; for any thread."""

    def __init__(self) -> None:
        self.gone_end = 0
        """Frames before this one are not to be had."""
        self._frames, self._times, self._asked_s = range(0), 0, -math.inf
        self._lock = threading.Lock()

    def asks(self, frames: range, now_s: float, heard_s: float) -> bool:
        """Whether to ask for some frames now; for others than before, or for the same after a while again.

        heard_s: when the coordinator was heard last; of one that says nothing, nothing follows.
        """
        with self._lock:
            if frames.start < self.gone_end or now_s - self._asked_s < _AGAIN_S:
                return False
            if frames != self._frames:
                self._frames, self._times = frames, 0
            elif heard_s > self._asked_s:
                self._times += 1
            if self._times >= _MOST:
                self.gone_end = frames.stop
                return False
            self._asked_s = now_s
            return True
