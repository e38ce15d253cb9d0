"""Tracking a take with local processes: what `xormocap track` does."""

import json
import shutil
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zmq

from proto.framing import MalformedMessage
from proto.messages import Pose
from proto.sockets import connect, make_socket, receive, wait
from proto.streams import stream_endpoint
from services.launcher import Launcher, free_endpoint
from services.mocap.take.folder import Take

_LOOK_S = 0.2


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    frames_done: int
    frames_per_s: float
    energy_px: float
    stage: str
    """What is being done, in words."""


class Interrupted(Exception):  # noqa: N818  (a request, not an error)
    """The run was stopped before its end; the frames solved by then were written."""


class _PoseWatch:
    """Follows the poses of a run for its progress."""

    def __init__(self, endpoint: str) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = make_socket(self._context, zmq.SUB)
        connect(self._socket, stream_endpoint(endpoint, "poses"))
        self._frames: set[int] = set()
        self._started_s = time.monotonic()
        self._first_s: float | None = None
        self._energy_px = 0.0

    def look(self, ended: bool) -> Progress:
        """Wait a moment for poses; returns the state of things."""
        wait([self._socket], _LOOK_S)
        try:
            while (message := receive(self._socket)) is not None:
                if isinstance(message, Pose):
                    self._first_s = self._first_s or time.monotonic()
                    self._frames.add(message.frame)
                    self._energy_px = message.energy_px
        except MalformedMessage:
            pass  # progress only; the recorder counts
        stage = "writing results" if ended else "tracking" if self._frames else "finding the first pose"
        done, elapsed_s = len(self._frames), time.monotonic() - (self._first_s or self._started_s)
        return Progress(done, max(done - 1, 0) / elapsed_s if elapsed_s > 0 else 0.0, self._energy_px, stage)

    def close(self) -> None:
        self._socket.close()
        self._context.term()


class StopSignals:
    """Counts SIGINT and SIGTERM while a run lasts: the first ends it in order, the second at once."""

    def __init__(self) -> None:
        self.count = 0
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, *_: object) -> None:
        self.count += 1


def track(
    take: Take,
    out: Path,
    *,
    workers: int,
    frames: str,
    overlay: bool,
    show: Callable[[Progress], None],
    warn: Callable[[str], None] = lambda _: None,
    started: Callable[[Launcher], None] = lambda _: None,
) -> dict[str, Any]:
    """Track a checked take into out and return its run.json; the processes' logs go to out/logs.

    warn is called with each warning of the coordinator's at the end; started once with the launcher when all
    processes run. Raises UserError, ServiceFailedError, or Interrupted once a stop was asked for and what was
    done is written.
    """
    stop, endpoint = StopSignals(), free_endpoint()
    with tempfile.TemporaryDirectory(prefix="xormocap-") as logs, Launcher(Path(logs)) as launcher:
        folder = str(take.folder)
        launcher.start(
            "coordinator",
            "--take",
            folder,
            "--bind",
            endpoint,
            "--frames",
            frames,
            "--workers",
            str(workers),
            "--recorders",
            "1",
        )
        launcher.start("limb_worker", "--connect", endpoint, copies=workers)
        launcher.start("segmentation", "--take", folder, "--connect", endpoint)
        launcher.start(
            "recorder",
            "--take",
            folder,
            "--out",
            str(out),
            "--connect",
            endpoint,
            "--overlay" if overlay else "--no-overlay",
        )
        started(launcher)
        _follow(launcher, endpoint, stop, show)
        launcher.stop()
        for sentence in launcher.warnings("coordinator"):
            warn(sentence)
        if out.is_dir():
            shutil.copytree(logs, out / "logs")
    if stop.count:
        raise Interrupted
    return dict(json.loads((out / "run.json").read_text()))


def _follow(launcher: Launcher, endpoint: str, stop: StopSignals, show: Callable[[Progress], None]) -> None:
    """Watch until the recorder has written everything, or a second stop is asked for."""
    watch, told = _PoseWatch(endpoint), False
    try:
        while not launcher.has_ended("recorder") and stop.count < 2:
            launcher.watch()
            show(watch.look(ended=launcher.has_ended("coordinator")))
            if stop.count and not told:
                told = True
                launcher.signal("coordinator", signal.SIGTERM)
        launcher.watch()
    finally:
        watch.close()
