"""How far a process lets others go first."""

import os
import sys
import threading
from contextlib import suppress
from pathlib import Path

_GROUP = Path("/proc/self/autogroup")
"""Where Linux keeps how far all processes of a session give way to those of others. Between sessions it does
not look at the processes' own niceness, and a launcher starts each service in a session of its own."""


def give_way(niceness: int) -> None:
    """Be that much nicer, to processes of other sessions as well where this one leads one; 0: as before."""
    own = os.nice(niceness)
    for thread in threading.enumerate() if sys.platform == "linux" else ():  # there each has its own
        if thread.native_id is not None:
            with suppress(OSError):  # it has ended
                os.setpriority(os.PRIO_PROCESS, thread.native_id, own)
    if niceness and os.getsid(0) == os.getpid():  # of another's session this one would slow the others, too
        with suppress(OSError):  # systems without such groups have no such file
            _GROUP.write_text(str(own))
