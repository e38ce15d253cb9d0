"""Fork servers that outlast a run: to import all services takes seconds of processor time, for every run."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from services.runs.fork_server import ForkServer

_CHANGING = "PYTEST_CURRENT_TEST"


class _LastingServer(ForkServer):
    """A server whose end launchers do not decide on."""

    def close(self) -> None:
        """Nothing: another run may need it."""

    def end(self) -> None:
        super().close()

    @property
    def pid(self) -> int:
        return self._process.pid


class LastingServers:
    """One server for each environment and working directory; called in place of ForkServer."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._servers: dict[object, _LastingServer] = {}

    def __call__(self, modules: Iterable[str], environment: Mapping[str, str], _: Path) -> ForkServer:
        known = {name: value for name, value in environment.items() if name != _CHANGING}
        key = Path.cwd(), frozenset(known.items())
        if key not in self._servers:
            log_path = self._logs / f"starts-{len(self._servers)}.log"
            self._servers[key] = _LastingServer(modules, known, log_path)
        return self._servers[key]

    @property
    def pids(self) -> set[int]:
        """The servers' process ids."""
        return {server.pid for server in self._servers.values()}

    def close(self) -> None:
        for server in self._servers.values():
            server.end()
