"""Log lines of a service, with the current task, and limited in number.

Every line has the current take, frame, pass and limb, if known. XORMOCAP_LOG=json makes each line a JSON
object.
"""

import json
import logging
import os
import sys
import time

VARIABLE = "XORMOCAP_LOG"
"""`text` (the default) or `json`."""
NOT_YET = " not yet: "
"""In the line with the reason why live pictures do not show the actor yet."""
_about: dict[str, str | int] = {}
"""The current task of the process; services do one thing at a time."""


def about(**facts: str | int | None) -> None:
    """Add these facts to all following lines; None removes one."""
    for name, fact in facts.items():
        if fact is None:
            _about.pop(name, None)
        else:
            _about[name] = fact


class SparingLog(logging.Filter):
    """Limits how often one line of the program may log, so that a hostile sender cannot fill the log."""

    def __init__(self, most: int = 100, period_s: float = 60.0) -> None:
        super().__init__()
        self._most, self._period_s = most, period_s
        self._seen: dict[tuple[str, int], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is among the first of its kind in the period; its kind is the line of code."""
        kind, now = (record.pathname, record.lineno), time.monotonic()
        began_s, count = self._seen.get(kind, (now, 0))
        if now - began_s > self._period_s:
            if count > self._most:
                record.msg = f"{record.msg} ({count - self._most} more of this kind were not logged)"
            began_s, count = now, 0
        self._seen[kind] = began_s, count + 1
        return count < self._most


class _AsText(logging.Formatter):
    """Lines that tell the service and what it is at."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """The line but for an exception's."""
        told = " ".join(f"{name}={fact}" for name, fact in _about.items())
        record.about = f"[{told}] " if told else ""
        return super().formatMessage(record)


class _AsJson(logging.Formatter):
    """The same as JSON objects."""

    def __init__(self, service: str) -> None:
        super().__init__()
        self._service = service

    def format(self, record: logging.LogRecord) -> str:
        """One line."""
        content = {
            "time": self.formatTime(record),
            "service": self._service,
            "pid": os.getpid(),
            "level": record.levelname,
            **_about,
            "message": record.getMessage(),
        }
        if record.exc_info:
            content["exception"] = self.formatException(record.exc_info)
        return json.dumps(content, ensure_ascii=False)


def begin(service: str) -> None:
    """Log to standard error as this service."""
    handler = logging.StreamHandler(sys.stderr)
    text = f"%(asctime)s {service} %(about)s%(levelname)s %(message)s"
    is_json = os.environ.get(VARIABLE, "text") == "json"
    handler.setFormatter(_AsJson(service) if is_json else _AsText(text))
    handler.addFilter(SparingLog())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
