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

from services.mocap.atomic import atomic_file
from services.mocap.body.actor import build_body
from services.mocap.energy.detail.cache import levels_of
from services.mocap.energy.settings import EngineSettings
from services.mocap.export.formats import write_defaults
from services.mocap.motion.settings import OutputSettings
from services.mocap.result.layout import LOGS, RUN_JSON, partial_of
from services.mocap.result.result import load_result
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import read_actor, take_actor
from services.mocap.take.fit_record import FIT_FOLDER, read_record
from services.mocap.take.folder import Take
from services.mocap.take.layout import ACTOR
from services.options import (
    DEFAULT_OUTPUT,
    DEFAULT_SEGMENTER,
    engine_arguments,
    output_arguments,
    search_arguments,
)
from services.runs.failures import Interrupted, ServiceFailedError
from services.runs.launcher import SERVICES, Launcher, free_endpoint, kinds_of_run
from services.runs.progress import PoseWatch, Progress
from services.segmentation.segmenters import chosen_segmenter

_ALONE_S = 2.0
"""How long after the coordinator's end a recorder that still waits for it is left waiting."""
_LEAVE_S = 10.0
"""How long a coordinator may take to end after the recorder."""
_STARTING_S = 10.0
"""How long a recorder may take to start."""
_CHECKS_S, _CHECK_LOOK_S = 20.0, 0.05
"""How long segmentation may take for its last checks."""


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


@dataclass(frozen=True)
class Job:
    """What to track, and how."""

    take: Take
    """Checked."""
    out: Path
    """The folder of the results."""
    frames: range
    workers: int
    """Limb workers."""
    overlay: bool
    engine: EngineSettings
    """Of the coordinator and every worker."""
    search: SearchSettings
    """Of the coordinator, whose tasks carry them."""
    fitted: Path | None = None
    """A folder of xormocap fit, whose actor and poses go before the take's; out/fit is a copy of it."""
    output: OutputSettings = DEFAULT_OUTPUT
    """How the recorder makes results of the poses."""
    segmenter: str = DEFAULT_SEGMENTER
    """What makes the silhouettes."""
    page: str | None = None
    """Where browsers can watch, as HOST:PORT; None: nowhere."""
    endpoint: str | None = None
    """Where the coordinator listens; None: at ports that are free."""


def track(
    job: Job,
    *,
    show: Callable[[Progress], None],
    warn: Callable[[str], None] = lambda _: None,
    started: Callable[[Launcher], None] = lambda _: None,
) -> dict[str, Any]:
    """Do a job and return its run.json, which tells of the actor's fit too; the logs go to out/logs.

    warn is called with each warning of segmentation, coordinator and recorder at the end; started once with
    the launcher when all processes run. Raises UserError; ServiceFailedError, after which the logs stay; or
    Interrupted, once a stop was asked for and what was done by then is written.
    """
    endpoint, logs = job.endpoint or free_endpoint(), Path(tempfile.mkdtemp(prefix="xormocap-logs-"))
    earlier = {folder: _written_ns(folder) for folder in (job.out, partial_of(job.out))}
    try:
        with StopSignals() as stop, Launcher(logs, kinds_of_run(job.page)) as launcher:
            _thin(job)
            _start(launcher, job, endpoint)
            started(launcher)
            _follow(launcher, endpoint, job.frames, stop, show)
            warned = ("segmentation", "coordinator", "recorder")
            for sentence in (sentence for service in warned for sentence in launcher.warnings(service)):
                warn(sentence)
    except ServiceFailedError as error:
        raise ServiceFailedError(f"{error}; the logs are in {logs}") from None
    folder = next((f for f, before in earlier.items() if _written_ns(f) != before), None)
    report = None if folder is None else _completed(folder, job)
    if folder is not None:
        shutil.rmtree(folder / LOGS, ignore_errors=True)
        shutil.move(logs, folder / LOGS)
        write_defaults(folder, load_result(folder), ("report",), warn)
    if report is not None and report["take"]["frames"] == len(job.frames):
        return report
    if stop.count:
        shutil.rmtree(logs, ignore_errors=True)
        raise Interrupted(folder)
    raise ServiceFailedError(f"the run ended before its last frame; the logs are in {logs}")


def _thin(job: Job) -> None:
    """Thin the body here, if its actor is known, so that not every process does it at the same time."""
    actor = take_actor(job.take) if job.fitted is None else read_actor(job.fitted / ACTOR)
    if actor is not None and job.search.detail_px > 0:
        levels_of(build_body(actor))


def _completed(folder: Path, job: Job) -> dict[str, Any]:
    """The run.json of a folder of results, in which the segmenter and the actor's fit, if any, now are."""
    report: dict[str, Any] = json.loads((folder / RUN_JSON).read_text())
    report["settings"]["segmenter"] = chosen_segmenter(job.take, job.segmenter)
    record = read_record(job.fitted or job.take.folder / FIT_FOLDER)
    is_its_fit = record is not None and record.actor == read_actor(folder / ACTOR).content_hash
    if record is not None and is_its_fit:
        report["fit"] = record.model_dump()
    with atomic_file(folder / RUN_JSON) as part:
        part.write_text(json.dumps(report, indent=2) + "\n")
    if is_its_fit and job.fitted is not None:
        shutil.rmtree(folder / FIT_FOLDER, ignore_errors=True)
        shutil.copytree(job.fitted, folder / FIT_FOLDER)
    return report


def _written_ns(folder: Path) -> int | None:
    """When a folder's results were written; None without any."""
    report = folder / RUN_JSON
    return report.stat().st_mtime_ns if report.exists() else None


def _start(launcher: Launcher, job: Job, endpoint: str) -> None:
    """Start all processes of a job."""
    source, connect = ("--take", str(job.take.folder)), ("--connect", endpoint)
    asked = ("--frames", f"{job.frames.start}:{job.frames.stop}")
    expected = ("--workers", str(job.workers), "--recorders", "1")
    energy, segmenter = engine_arguments(job.engine), ("--segmenter", job.segmenter)
    actor = () if job.fitted is None else ("--fitted", str(job.fitted))
    wanted = (*asked, *expected, *energy, *search_arguments(job.search), *segmenter, *actor)
    launcher.start("coordinator", *source, "--bind", endpoint, *wanted)
    launcher.start("limb_worker", *connect, *energy, copies=job.workers)
    launcher.start("segmentation", *source, *connect, *segmenter)
    drawing = "--overlay" if job.overlay else "--no-overlay"
    out = ("--out", str(job.out), drawing, "--no-report")  # the report comes with the fit
    launcher.start("recorder", *source, *connect, *out, *output_arguments(job.output))
    if job.page is not None:
        launcher.start("viewer", *source, *connect, "--bind", job.page, "--results", str(job.out))


def _follow(
    launcher: Launcher, endpoint: str, frames: range, stop: StopSignals, show: Callable[[Progress], None]
) -> None:
    """Watch until recorder and coordinator have ended, or a second stop is asked for."""
    watch, ended_s = PoseWatch(endpoint, frames), dict[str, float]()
    try:
        while stop.count < 2 and not (launcher.is_done("recorder") and launcher.has_ended("coordinator")):
            launcher.watch(over=SERVICES if "recorder" in ended_s else ())
            progress = watch.look(ended=launcher.is_done("coordinator"))
            show(progress)
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
                if alone_s > _ALONE_S or (stop.count and not progress.frames_done):
                    launcher.tell_to_stop("recorder")  # it writes what it has
        launcher.watch(over=SERVICES if launcher.is_done("recorder") else ())
        _await_checks(launcher, stop)
    finally:
        watch.close()


def _await_checks(launcher: Launcher, stop: StopSignals) -> None:
    """Wait until segmentation has looked at all clean plates: after a few frames it may not have."""
    deadline_s = time.monotonic() + _CHECKS_S
    while not stop.count and time.monotonic() < deadline_s and not launcher.has_ended("segmentation"):
        time.sleep(_CHECK_LOOK_S)
