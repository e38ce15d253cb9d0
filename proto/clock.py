"""The clock that live input is measured by."""

from pathlib import Path
from socket import gethostname


def clock_name() -> str:
    """Names the monotonic clock of this machine since it was started, which all its processes read alike."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return gethostname()
