"""All services of one take as local processes: started, watched, and ended together."""

import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from services.mocap.errors import UserError
from services.process import EXIT_STOPPED, EXIT_USER_ERROR, KEYS_VARIABLE, PARENT_VARIABLE

log = logging.getLogger(__name__)

_PORTS = 3
_STOP_S = 4.0
"""How long processes may take to end after a SIGTERM before they get another."""
_ORDERLY = (0, EXIT_STOPPED, -signal.SIGTERM)
"""How a process ends that was told to; the last, when it was told before it could listen."""
_MOST_RESTARTS = 20
"""Restarts of one kind of process in one run; more mean that it cannot work here."""


@dataclass(frozen=True)
class ServiceSpec:
    """A kind of process."""

    module: str
    restarts: bool
    """Whether another takes the place of one that dies; the others' end ends the run."""
    stop_s: float = 5.0
    """How long a process may take to end after a second SIGTERM before it is killed."""


SERVICES: dict[str, ServiceSpec] = {
    "coordinator": ServiceSpec("services.coordinator", restarts=False),
    "limb_worker": ServiceSpec("services.limb_worker", restarts=True),
    "segmentation": ServiceSpec("services.segmentation", restarts=True),
    "viewer": ServiceSpec("services.viewer", restarts=True),
    "recorder": ServiceSpec("services.recorder", restarts=False, stop_s=60.0),  # it may be writing
}


class ServiceFailedError(Exception):
    """A service ended with an error that is not the user's; the text has its last line."""


@dataclass
class _Running:
    name: str
    arguments: list[str]
    log_path: Path
    process: "subprocess.Popen[bytes]"


class Launcher:
    """A context manager that leaves no process behind."""

    def __init__(self, log_folder: Path) -> None:
        self._log_folder = log_folder
        self._running: list[_Running] = []
        self._restarts: Counter[str] = Counter()
        self._told: set[str] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, name: str, *arguments: str, copies: int = 1) -> None:
        """Start processes of a kind; each logs to a file of its own."""
        for _ in range(copies):
            log_path = self._log_folder / f"{name}-{len(self._running)}.log"
            process = self._spawn(name, list(arguments), log_path)
            self._running.append(_Running(name, list(arguments), log_path, process))

    def _spawn(self, name: str, arguments: list[str], log_path: Path) -> "subprocess.Popen[bytes]":
        with log_path.open("ab") as log_file:
            return subprocess.Popen(  # noqa: S603  (our own modules)
                [sys.executable, "-m", SERVICES[name].module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log_file,
                stderr=log_file,
                env={**_without_keys(os.environ), PARENT_VARIABLE: str(os.getpid())},
                start_new_session=True,  # Ctrl-C reaches the launcher only, which ends the run in order
            )

    def pids(self, name: str) -> list[int]:
        """Process ids of a kind's living processes."""
        return [r.process.pid for r in self._running if r.name == name and r.process.poll() is None]

    def has_ended(self, name: str) -> bool:
        """Whether no process of a kind is left."""
        return not self.pids(name)

    def watch(self) -> None:
        """Restart what may be restarted; raise for what may not.

        Raises UserError with a service's own sentence, or ServiceFailedError.
        """
        for running in self._running:
            code = running.process.poll()
            if code is None or code == 0 or (running.name in self._told and code in _ORDERLY):
                continue
            if code == EXIT_USER_ERROR:
                raise UserError(_last_line(running.log_path))
            self._restarts[running.name] += 1
            if not SERVICES[running.name].restarts or self._restarts[running.name] > _MOST_RESTARTS:
                raise ServiceFailedError(
                    f"{running.name} ended with code {code}: {_last_line(running.log_path)}"
                )
            last = _last_line(running.log_path)
            log.warning("%s ended with code %d: starting another; it said: %s", running.name, code, last)
            running.process = self._spawn(running.name, running.arguments, running.log_path)

    def tell_to_stop(self, name: str) -> None:
        """Ask a kind's processes to end in order, once."""
        if name not in self._told:
            self._told.add(name)
            for pid in self.pids(name):
                os.kill(pid, signal.SIGTERM)

    def warnings(self, name: str) -> list[str]:
        """What a kind's processes have warned of, one sentence each, without time and name."""
        lines = [line for r in self._running if r.name == name for line in _lines(r.log_path)]
        return [line.partition(" WARNING ")[2] for line in lines if " WARNING " in line]

    def stop(self) -> None:
        """End all processes: SIGTERM, a moment, SIGTERM again for those that finish something, SIGKILL."""
        self._told |= set(SERVICES)
        for _ in range(2):
            for running in self._running:
                if running.process.poll() is None:
                    running.process.terminate()
            self._wait(lambda _: _STOP_S)
        self._wait(lambda spec: spec.stop_s)
        for running in self._running:
            if running.process.poll() is None:
                running.process.kill()
                running.process.wait()

    def _wait(self, patience_s: Callable[[ServiceSpec], float]) -> None:
        """Wait for all processes, each so long as its kind is granted."""
        began = time.monotonic()
        for running in self._running:
            left_s = began + patience_s(SERVICES[running.name]) - time.monotonic()
            with suppress(subprocess.TimeoutExpired):
                running.process.wait(max(left_s, 0.01))


def _without_keys(environment: Mapping[str, str]) -> dict[str, str]:
    """What is meant for services beyond this machine is not for those on its loopback."""
    return {name: value for name, value in environment.items() if name != KEYS_VARIABLE}


def free_endpoint() -> str:
    """A loopback endpoint whose ports are free at this moment."""
    for _ in range(100):
        with socket.socket() as first:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
        if port + _PORTS < 65536 and all(_is_free(port + k) for k in range(_PORTS)):
            return f"tcp://127.0.0.1:{port}"
    raise ServiceFailedError("no three free ports in a row on 127.0.0.1")


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _last_line(path: Path) -> str:
    lines = _lines(path)
    return lines[-1] if lines else "it said nothing"


def _lines(path: Path) -> list[str]:
    return [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
