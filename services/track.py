"""Tracking a take with local processes: what `xormocap track` does."""

import json
import shutil
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import zmq

from proto.framing import MalformedMessage
from proto.messages import Pose
from proto.sockets import connect, make_socket, receive, wait
from proto.streams import stream_endpoint
from services.launcher import SERVICES, Launcher, ServiceFailedError, free_endpoint
from services.mocap.atomic import atomic_file
from services.mocap.body.actor import build_body
from services.mocap.energy.detail.cache import levels_of
from services.mocap.energy.settings import EngineSettings
from services.mocap.export.formats import write_defaults
from services.mocap.motion.settings import OutputSettings
from services.mocap.result.layout import LOGS, RUN_JSON
from services.mocap.result.result import load_result
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import read_actor, take_actor
from services.mocap.take.fit_record import FIT_FOLDER, read_record
from services.mocap.take.folder import Take
from services.mocap.take.layout import ACTOR
from services.process import (
    DEFAULT_OUTPUT,
    DEFAULT_SEGMENTER,
    engine_arguments,
    output_arguments,
    search_arguments,
)
from services.recorder.result_folder import partial_of
from services.segmentation.segmenters import chosen_segmenter

_LOOK_S = 0.2
_ALONE_S = 2.0
"""How long after the coordinator's end a recorder that still waits for it is left waiting."""
_LEAVE_S = 10.0
"""How long a coordinator may take to end after the recorder."""
_STARTING_S = 10.0
"""How long a recorder may take to start."""


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    frames_done: int
    frames_per_s: float
    energy_px: float
    stage: str
    """What is being done, in words."""


class Interrupted(Exception):  # noqa: N818  (a request, not an error)
    """The run was stopped before its end."""

    def __init__(self, folder: Path | None) -> None:
        """Folder: where the frames solved by then are; None where there were none."""
        super().__init__(folder)
        self.folder = folder


class _PoseWatch:
    """Follows the poses of a run for its progress."""

    def __init__(self, endpoint: str, frames: range) -> None:
        self._start, self._end = frames.start, frames.start
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
                    self._end = max(self._end, message.frame + 1)
                    self._energy_px = message.energy_px
        except MalformedMessage:
            pass  # progress only; the recorder counts
        stage = "writing results" if ended else "tracking" if self._frames else "finding the first pose"
        seen, elapsed_s = len(self._frames), time.monotonic() - (self._first_s or self._started_s)
        frames_per_s = max(seen - 1, 0) / elapsed_s if elapsed_s > 0 else 0.0
        return Progress(self._end - self._start, frames_per_s, self._energy_px, stage)

    def close(self) -> None:
        self._socket.close()
        self._context.term()


class StopSignals:
    """Counts SIGINT and SIGTERM inside its block: the first ends a run in order, the second at once."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Self:
        numbers = (signal.SIGINT, signal.SIGTERM)
        self._before = {number: signal.signal(number, self._note) for number in numbers}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, *_: object) -> None:
        self.count += 1


def track(
    take: Take,
    out: Path,
    *,
    workers: int,
    frames: range,
    overlay: bool,
    engine: EngineSettings,
    search: SearchSettings,
    show: Callable[[Progress], None],
    fitted: Path | None = None,
    output: OutputSettings = DEFAULT_OUTPUT,
    page: str | None = None,
    segmenter: str = DEFAULT_SEGMENTER,
    warn: Callable[[str], None] = lambda _: None,
    started: Callable[[Launcher], None] = lambda _: None,
    endpoint: str | None = None,
) -> dict[str, Any]:
    """Track frames of a checked take into out and return its run.json; the processes' logs go to out/logs.

    engine: for the coordinator and every worker; search: for the coordinator, whose tasks carry it. fitted: a
    folder of xormocap fit, whose actor and poses take the place of the take's; out/fit gets a copy of it.
    output: how the recorder makes results of the poses. page: where browsers can watch, as HOST:PORT; None:
    nowhere. segmenter: what makes the silhouettes.
    run.json tells of the fit that the actor comes from. warn is called with each warning of segmentation,
    coordinator and recorder at the end; started once with the launcher when all processes run. endpoint:
    where the coordinator listens, by default at ports that are free. Raises UserError; ServiceFailedError,
    after which the logs stay; or Interrupted, once a stop was asked for and what was done by then is written.
    """
    endpoint, logs = endpoint or free_endpoint(), Path(tempfile.mkdtemp(prefix="xormocap-logs-"))
    earlier = {folder: _written_ns(folder) for folder in (out, partial_of(out))}
    try:
        with StopSignals() as stop, Launcher(logs) as launcher:
            _thin(take, fitted, search)
            _start(
                launcher, take.folder, out, endpoint, workers, frames, overlay, engine, search, fitted,
                output, segmenter,
            )  # fmt: skip
            if page is not None:
                watched = ("--take", str(take.folder), "--connect", endpoint)
                launcher.start("viewer", *watched, "--bind", page, "--results", str(out))
            started(launcher)
            _follow(launcher, endpoint, frames, stop, show)
            warned = ("segmentation", "coordinator", "recorder")
            for sentence in (sentence for service in warned for sentence in launcher.warnings(service)):
                warn(sentence)
    except ServiceFailedError as error:
        raise ServiceFailedError(f"{error}; the logs are in {logs}") from None
    folder = next((f for f, before in earlier.items() if _written_ns(f) != before), None)
    report = None if folder is None else _completed(folder, take, fitted, segmenter)
    if folder is not None:
        shutil.rmtree(folder / LOGS, ignore_errors=True)
        shutil.move(logs, folder / LOGS)
        write_defaults(folder, load_result(folder), ("report",), warn)
    if report is not None and report["take"]["frames"] == len(frames):
        return report
    if stop.count:
        shutil.rmtree(logs, ignore_errors=True)
        raise Interrupted(folder)
    raise ServiceFailedError(f"the run ended before its last frame; the logs are in {logs}")


def _thin(take: Take, fitted: Path | None, search: SearchSettings) -> None:
    """Thin the body here, if its actor is known, so that not every process does it at the same time."""
    actor = take_actor(take) if fitted is None else read_actor(fitted / ACTOR)
    if actor is not None and search.detail_px > 0:
        levels_of(build_body(actor))


def _completed(folder: Path, take: Take, fitted: Path | None, segmenter: str) -> dict[str, Any]:
    """The run.json of a folder of results, in which the segmenter and the actor's fit, if any, now are.

    report.html tells of the fit too.
    """
    report: dict[str, Any] = json.loads((folder / RUN_JSON).read_text())
    report["settings"]["segmenter"] = chosen_segmenter(take, segmenter)
    with atomic_file(folder / RUN_JSON) as part:
        part.write_text(json.dumps(report, indent=2) + "\n")
    source = fitted or take.folder / FIT_FOLDER
    record = read_record(source)
    if record is None or record.actor != read_actor(folder / ACTOR).content_hash:
        return report
    report["fit"] = record.model_dump()
    with atomic_file(folder / RUN_JSON) as part:
        part.write_text(json.dumps(report, indent=2) + "\n")
    if fitted is not None:
        shutil.rmtree(folder / FIT_FOLDER, ignore_errors=True)
        shutil.copytree(fitted, folder / FIT_FOLDER)
    return report


def _written_ns(folder: Path) -> int | None:
    """When a folder's results were written; None without any."""
    report = folder / RUN_JSON
    return report.stat().st_mtime_ns if report.exists() else None


def _start(
    launcher: Launcher,
    take: Path,
    out: Path,
    endpoint: str,
    workers: int,
    frames: range,
    overlay: bool,
    engine: EngineSettings,
    search: SearchSettings,
    fitted: Path | None,
    output: OutputSettings,
    segmenter: str,
) -> None:
    """Start all processes of a run."""
    asked = f"{frames.start}:{frames.stop}"
    source, connect = ("--take", str(take)), ("--connect", endpoint)
    expected = ("--workers", str(workers), "--recorders", "1")
    energy = engine_arguments(engine)
    actor = () if fitted is None else ("--fitted", str(fitted))
    wanted = (*expected, *energy, *search_arguments(search), *actor)
    launcher.start("coordinator", *source, "--bind", endpoint, "--frames", asked, *wanted)
    launcher.start("limb_worker", *connect, *energy, copies=workers)
    launcher.start("segmentation", *source, *connect, "--segmenter", segmenter)
    drawing = "--overlay" if overlay else "--no-overlay"
    results = ("--out", str(out), drawing, "--no-report", *output_arguments(output))  # it comes with the fit
    launcher.start("recorder", *source, *connect, *results)


def _follow(
    launcher: Launcher, endpoint: str, frames: range, stop: StopSignals, show: Callable[[Progress], None]
) -> None:
    """Watch until recorder and coordinator have ended, or a second stop is asked for."""
    watch, ended_s = _PoseWatch(endpoint, frames), dict[str, float]()
    try:
        while stop.count < 2 and not (launcher.is_done("recorder") and launcher.has_ended("coordinator")):
            launcher.watch(over=SERVICES if "recorder" in ended_s else ())
            show(watch.look(ended=launcher.is_done("coordinator")))
            for name in ("coordinator", "recorder"):
                if launcher.is_done(name):
                    ended_s.setdefault(name, time.monotonic())
            if stop.count:
                launcher.tell_to_stop("coordinator")
            if "recorder" in ended_s and time.monotonic() - ended_s["recorder"] > _LEAVE_S:
                break
            if "coordinator" in ended_s:
                alone_s = min(
                    time.monotonic() - ended_s["coordinator"], launcher.up_s("recorder") - _STARTING_S
                )
                if alone_s > _ALONE_S:
                    launcher.tell_to_stop("recorder")  # it writes what it has
        launcher.watch(over=SERVICES if launcher.is_done("recorder") else ())
    finally:
        watch.close()
