"""Processes in sessions of their own give way to each other."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

_OWN = """
import os, threading
from services.process import give_way
woken = threading.Event()
other = threading.Thread(target=woken.wait)
other.start()
give_way(10)
print(os.nice(0), os.getpriority(os.PRIO_PROCESS, other.native_id))
woken.set()
"""
_GROUP = "print(open('/proc/self/autogroup').read().split()[-1])"


def _groups_sessions() -> bool:
    """A kernel that is told not to, or that has put all of a container in one group, says nothing there."""
    file = Path("/proc/self/autogroup")
    return file.exists() and bool(file.read_text().strip())


@pytest.mark.skipif(not _groups_sessions(), reason="this system does not group sessions")
@pytest.mark.parametrize("leads", [True, False])
def test_only_who_leads_a_session_makes_all_of_it_nice(leads: bool) -> None:
    before = Path("/proc/self/autogroup").read_text().split()[-1]
    command = [sys.executable, "-c", _OWN + _GROUP]
    said = subprocess.run(
        command, capture_output=True, text=True, check=True, start_new_session=leads
    ).stdout.split()
    expected = str(min(os.nice(0) + 10, 19))
    assert said == [expected, expected, expected if leads else before]
