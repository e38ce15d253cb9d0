"""What every service process needs: logging, an orderly stop, and errors told as one sentence."""

import logging
import os
import signal
import socket
import sys
from collections.abc import Callable
from types import FrameType

from proto.streams import AddressError
from services.mocap.errors import UserError

PARENT_VARIABLE = "XORMOCAP_PARENT"
"""Process id of a launcher; a service whose parent is no longer that one stops, so that none is orphaned."""

EXIT_USER_ERROR = 2


class StopRequest:
    """True once the process was asked to stop, by SIGINT, SIGTERM or the end of its launcher."""

    def __init__(self) -> None:
        self._asked = False
        self._parent = int(os.environ.get(PARENT_VARIABLE, "0"))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002  (the signature of handlers)
        self._asked = True

    def __bool__(self) -> bool:
        return self._asked or (self._parent != 0 and os.getppid() != self._parent)


def client_name(role: str) -> str:
    """A name that no other process has: role, host and process id."""
    return f"{role}@{socket.gethostname()}:{os.getpid()}"


def run_service(name: str, main: Callable[[StopRequest], None]) -> None:
    """Run a service's main function as this process, then exit: 0 when done, 2 for an error of the user's."""
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format=f"%(asctime)s {name} %(levelname)s %(message)s"
    )
    try:
        main(StopRequest())
    except (UserError, AddressError) as error:
        print(error, file=sys.stderr)  # noqa: T201  (the one sentence that a launcher shows)
        sys.exit(EXIT_USER_ERROR)
    except Exception:
        logging.exception("unexpected error")
        sys.exit(1)
    sys.exit(0)
