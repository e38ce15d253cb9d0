"""Processes made by copying one: as if each had been started by itself."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from services.process import PARENT_VARIABLE
from services.runs.failures import ServiceFailedError
from services.runs.fork_server import Birth, ForkServer

_TOY = """
import os, sys, time

def main(code: int, seconds: float = 0.0) -> None:
    parent, name = int(os.environ["PARENT"]), open("/proc/self/comm").read().strip()
    print(name, os.getsid(0) == os.getpid(), parent == os.getppid(), flush=True)
    print(sys.stdin.read() == "", file=sys.stderr)
    time.sleep(seconds)
    sys.exit(code)
""".replace("PARENT", PARENT_VARIABLE)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="launchers use it there only")


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Where a package toy can be imported, and one that cannot."""
    for name, code in (("toy", _TOY), ("broken", "import no_such_module\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
        (tmp_path / name / "__main__.py").write_text(code)
    return {**os.environ, "PYTHONPATH": f"{tmp_path}:{Path.cwd()}"}


@pytest.fixture
def server(environment: dict[str, str]) -> Iterator[ForkServer]:
    made = ForkServer(["toy"], environment)
    yield made
    made.close()


def toy(tmp_path: Path, *arguments: str) -> Birth:
    return Birth("toy", list(arguments), str(tmp_path / "toy.log"))


def test_a_copy_is_a_process_of_its_own(server: ForkServer, tmp_path: Path) -> None:
    (tmp_path / "toy.log").write_text("earlier\n")
    first, second = server.start(toy(tmp_path, "7")), server.start(toy(tmp_path, "0"))
    assert (first.wait(20), second.wait(20)) == (7, 0)
    lines = (tmp_path / "toy.log").read_text().splitlines()
    assert (lines[0], sorted(lines[1:])) == ("earlier", ["True", "True", "toy True True", "toy True True"])


def test_signals_and_their_codes(server: ForkServer, tmp_path: Path) -> None:
    sleeping = server.start(toy(tmp_path, "0", "--seconds", "60"))
    assert sleeping.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        sleeping.wait(0.05)
    sleeping.send_signal(signal.SIGKILL)
    assert sleeping.wait(20) == -signal.SIGKILL
    sleeping.send_signal(signal.SIGTERM)  # nothing is there any more, and nothing else is hit


def test_wrong_arguments_end_as_they_do_elsewhere(server: ForkServer, tmp_path: Path) -> None:
    assert server.start(toy(tmp_path, "--nonsense")).wait(20) == 2
    assert "No such option" in (tmp_path / "toy.log").read_text()


def test_without_the_server_nothing_is_waited_for(server: ForkServer, tmp_path: Path) -> None:
    sleeping = server.start(toy(tmp_path, "0", "--seconds", "60"))
    starter = psutil.Process(sleeping.pid).parent()
    assert starter is not None
    starter.kill()
    starter.wait(20)
    assert sleeping.wait(20) == 1
    with pytest.raises(ServiceFailedError, match="the process that starts services has ended"):
        server.start(toy(tmp_path, "0"))
    os.kill(sleeping.pid, signal.SIGKILL)  # services look after their parent themselves


def test_what_cannot_be_imported_is_said(environment: dict[str, str], tmp_path: Path) -> None:
    server = ForkServer(["broken"], environment)
    with pytest.raises(
        ServiceFailedError, match="ended: ModuleNotFoundError: No module named 'no_such_module'"
    ):
        server.start(toy(tmp_path, "0"))
    server.close()
