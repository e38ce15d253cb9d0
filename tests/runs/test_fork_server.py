"""Processes made by copying one: as if each had been started by itself."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from services.process import PARENT_VARIABLE
from services.runs import ServiceFailedError
from services.runs.fork_server import Birth, ForkServer
from services.runs.launcher import SERVICES, Launcher, ServiceSpec

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
def server(tmp_path: Path) -> Iterator[ForkServer]:
    """Where a package toy can be imported, and one that cannot."""
    slow = "import time\ntime.sleep(60)\n"
    for name, code in (("toy", _TOY), ("broken", "import no_such_module\n"), ("slow", slow)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
        (tmp_path / name / "__main__.py").write_text(code)
    made = ForkServer(["toy"], _environment(tmp_path), tmp_path / "starts.log")
    yield made
    made.close()


def _environment(tmp_path: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": f"{tmp_path}:{Path.cwd()}"}


def birth(tmp_path: Path, *arguments: str, module: str = "toy") -> Birth:
    return Birth(module, list(arguments), str(tmp_path / "toy.log"))


def test_a_copy_is_a_process_of_its_own(server: ForkServer, tmp_path: Path) -> None:
    (tmp_path / "toy.log").write_text("earlier\n")
    first, second = server.start(birth(tmp_path, "7")), server.start(birth(tmp_path, "0"))
    assert (first.wait(20), second.wait(20)) == (7, 0)
    lines = (tmp_path / "toy.log").read_text().splitlines()
    assert (lines[0], sorted(lines[1:])) == ("earlier", ["True", "True", "toy True True", "toy True True"])
    server.close()
    assert not (tmp_path / "starts.log").exists(), "nothing was wrong"


def test_signals_and_their_codes(server: ForkServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sleeping = server.start(birth(tmp_path, "0", "--seconds", "60"))
    assert sleeping.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        sleeping.wait(0.05)
    sleeping.send_signal(signal.SIGKILL)
    assert sleeping.wait(20) == -signal.SIGKILL
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("another process may have its number now"))
    sleeping.send_signal(signal.SIGTERM)


def test_wrong_arguments_end_as_they_do_elsewhere(server: ForkServer, tmp_path: Path) -> None:
    assert server.start(birth(tmp_path, "--nonsense")).wait(20) == 2
    assert "No such option" in (tmp_path / "toy.log").read_text()


def test_threads_may_look_while_others_start(server: ForkServer, tmp_path: Path) -> None:
    sleeping, over = server.start(birth(tmp_path, "0", "--seconds", "60")), threading.Event()

    def look() -> None:
        while not over.is_set():
            assert sleeping.poll() is None

    with ThreadPoolExecutor(2) as pool:
        looks = [pool.submit(look) for _ in range(2)]
        codes = [server.start(birth(tmp_path, str(code))).wait(20) for code in range(1, 9)]
        over.set()
        for looked in looks:
            looked.result(20)
    assert codes == list(range(1, 9))
    sleeping.send_signal(signal.SIGKILL)
    assert sleeping.wait(20) == -signal.SIGKILL


def test_without_the_server_a_process_runs_until_it_has_ended(server: ForkServer, tmp_path: Path) -> None:
    sleeping = server.start(birth(tmp_path, "0", "--seconds", "60"))
    starter = psutil.Process(sleeping.pid).parent()
    assert starter is not None
    starter.kill()
    starter.wait(20)
    assert sleeping.poll() is None
    with pytest.raises(ServiceFailedError, match="the process that starts services has ended"):
        server.start(birth(tmp_path, "0"))
    sleeping.send_signal(signal.SIGKILL)
    assert sleeping.wait(20) == 1  # nobody has seen how


def test_what_cannot_be_imported_is_said(server: ForkServer, tmp_path: Path) -> None:
    with pytest.raises(
        ServiceFailedError, match="ended: ModuleNotFoundError: No module named 'no_such_module'"
    ):
        server.start(birth(tmp_path, module="broken"))
    assert "Traceback" in (tmp_path / "starts.log").read_text()


def test_a_log_that_cannot_be_written_is_no_end(server: ForkServer, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        server.start(Birth("toy", ["0"], str(tmp_path / "nowhere" / "toy.log")))
    assert server.start(birth(tmp_path, "3")).wait(20) == 3


@pytest.mark.usefixtures("server")
def test_a_server_that_still_loads_code_is_closed_at_once(tmp_path: Path) -> None:
    loading = ForkServer(["slow"], _environment(tmp_path), tmp_path / "slow.log")
    assert loading.is_running
    loading.close()
    assert not loading.is_running


def test_launchers_share_a_server_as_long_as_it_runs(
    server: ForkServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", _environment(tmp_path)["PYTHONPATH"])
    monkeypatch.setitem(SERVICES, "toy", ServiceSpec("toy", most_restarts=0))
    starters = []
    for _ in range(3):
        logs = tmp_path / f"logs{len(starters)}"
        logs.mkdir()
        with Launcher(logs, ["toy"], server) as launcher:
            launcher.start("toy", "0", "--seconds", "60")
            starter = psutil.Process(launcher.pids("toy")[0]).parent()
        assert starter is not None
        starters.append(starter)
        if len(starters) == 2:
            starter.kill()
            starter.wait(20)
    assert starters[0] == starters[1] != starters[2]
    assert not starters[2].is_running(), "the third launcher has made a server for itself"
