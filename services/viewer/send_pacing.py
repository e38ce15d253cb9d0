"""When something of a page may be sent again, and how much of it."""

import time

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
