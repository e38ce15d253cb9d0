"""Whether a service is well: its loop touches a file, and `python -m services.health` looks how old that is.

The environment names the file; without a name there is none. A container's probe asks every few seconds, so
this module imports next to nothing.
"""

import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

VARIABLE = "XORMOCAP_HEALTH"
"""Path of the file that the service touches."""
HUNG_AFTER_S = 60.0
"""A service whose main loop has not run for this long counts as hung; the first pose takes some seconds."""
_BEFORE_FIRST_ROUND = 0
"""The file's time until the loop has come round once."""
_CLOCK_DIGITS = 3


@contextmanager
def heartbeat(service: str) -> Iterator[None]:
    """Keep the file inside this block, if the environment names one; raises OSError where it cannot be."""
    path = os.environ.get(VARIABLE)
    if not path:
        yield
        return
    Path(path).write_text(service)
    os.utime(path, (_BEFORE_FIRST_ROUND, _BEFORE_FIRST_ROUND))
    try:
        yield
    finally:
        Path(path).unlink(missing_ok=True)


def beat() -> None:
    """Tell that the service's loop has come round; where that cannot be told, the service goes on."""
    if path := os.environ.get(VARIABLE):
        with suppress(OSError):
            Path(path).touch()


def health() -> None:
    """Tell whether the service that touches the file XORMOCAP_HEALTH works, as a container's probe does."""
    path = os.environ.get(VARIABLE)
    if not path:
        sys.exit(f"{VARIABLE}: expected the path of the file that a service touches")
    try:
        service, touched_s = Path(path).read_text(), Path(path).stat().st_mtime
    except FileNotFoundError:
        sys.exit(f"{path}: no service is running that touches it")
    now_s = time.time()  # noqa: TID251  (the clock of files' times)
    silent_s = None if touched_s == _BEFORE_FIRST_ROUND else round(now_s - touched_s, _CLOCK_DIGITS)
    state = "starting" if silent_s is None else "working" if silent_s < HUNG_AFTER_S else "hung"
    sys.stdout.write(json.dumps({"service": service, "state": state, "silent_s": silent_s}) + "\n")
    sys.exit(0 if state == "working" else 1)


if __name__ == "__main__":
    health()
