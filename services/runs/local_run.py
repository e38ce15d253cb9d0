"""What tracking a recorded take and tracking live have in common: processes started, followed, and ended."""

import re
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from proto.messages import Telemetry
from services.mocap.body.actor import Actor, build_body
from services.mocap.energy.detail.cache import levels_of
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import UserError
from services.mocap.motion.settings import OutputSettings
from services.mocap.result.layout import LOGS, RUN_JSON
from services.mocap.search.settings import SearchSettings
from services.options import (
    DEFAULT_OUTPUT,
    DEFAULT_SEGMENTER,
    engine_arguments,
    keys_of_client,
    output_arguments,
    search_arguments,
)  # fmt: skip
from services.process import StopRequest
from services.runs import ServiceFailedError
from services.runs.fork_server import ForkServer
from services.runs.launcher import SERVICES, Launcher
from services.runs.progress import Progress, ProgressWatch

LOOK_S = 0.2
_LEAVE_S = 10.0
"""How long a coordinator may take to exit after the recorder."""
_STARTING_S = 10.0
"""How long a recorder may take to start."""
_CHECKS_S, _CHECKED_EVERY_S = 20.0, 0.05
"""How long segmentation may take for its last checks."""

Arguments: TypeAlias = tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Job:
    """What every run is told."""

    out: Path
    """The folder of the results."""
    workers: int
    """Limb workers."""
    engine: EngineSettings
    """Of the coordinator and every worker."""
    search: SearchSettings
    """Of the coordinator, whose tasks carry them."""
    output: OutputSettings = DEFAULT_OUTPUT
    """How the recorder turns poses into results."""
    segmenter: str = DEFAULT_SEGMENTER
    """What makes the silhouettes."""
    page: str | None = None
    """Address of the page, as HOST:PORT; None: no page."""
    keys: Path | None = None
    """The folder of xormocap keys, if the coordinator listens beyond this machine."""
    forks: ForkServer | None = None
    """Starts all processes, if several runs share it; None: each run has its own."""

    @property
    def kinds(self) -> list[str]:
        """The kinds of processes that it takes."""
        return [kind for kind in SERVICES if kind != "viewer" or self.page is not None]


@dataclass(frozen=True, kw_only=True)
class RunSetup:
    """What tells one kind of run from another."""

    source: Path
    """The take, or what names the cameras."""
    endpoint: str
    """Where the coordinator listens."""
    coordinator: Arguments = ()
    limb_worker: Arguments = ()
    recorder: Arguments = ()
    viewer: Arguments = ()
    """Further arguments of these."""
    segmentation: Sequence[Arguments]
    """Further arguments of each process of segmentation."""
    actor: Actor | None = None
    """Whose body is thinned before all start, so that not every process does it at the same time."""
    first_frame: int = 0
    lasting: tuple[str, ...]
    """Kinds of processes whose end is waited for, beside the recorder's."""
    alone_s: float
    """How long a recorder may still wait for the coordinator after the coordinator's end."""


def run_services(
    job: Job,
    setup: RunSetup,
    show: Callable[[Progress], None],
    warn: Callable[[str], None],
    started: Callable[[Launcher], None] = lambda _: None,
) -> tuple[Path, bool, Telemetry | None]:
    """Start all processes, and watch until they have ended or a second stop is asked for.

    Returns the temporary folder of the logs, whether a stop was asked for, and the coordinator's last
    telemetry. warn is called with each warning of the services at the end; started once with the launcher
    when all processes run. Raises UserError, or ServiceFailedError, after which the logs stay.
    """
    logs = Path(tempfile.mkdtemp(prefix="xormocap-logs-"))
    try:
        with StopRequest() as stop, Launcher(logs, job.kinds, job.forks) as launcher:
            if setup.actor is not None and job.search.detail_px > 0:
                levels_of(build_body(setup.actor))
            _start(launcher, job, setup)
            started(launcher)
            telemetry = _follow(launcher, job, setup, stop, show)
            for service in ("segmentation", "coordinator", "recorder"):
                for sentence in launcher.warnings(service):
                    warn(sentence)
    except ServiceFailedError as error:
        raise ServiceFailedError(f"{error}; the logs are in {logs}") from None
    except UserError as error:
        if any("Traceback" in log.read_text(errors="replace") for log in logs.glob("*.log")):
            raise UserError(f"{error}; the logs are in {logs}") from None
        shutil.rmtree(logs, ignore_errors=True)
        raise
    return logs, stop.count > 0, telemetry


def _start(launcher: Launcher, job: Job, setup: RunSetup) -> None:
    """Start all processes of a run."""
    source, connect = ("--take", str(setup.source)), ("--connect", _from_here(setup.endpoint))
    energy, keys = engine_arguments(job.engine), _keys(job)
    expected = ("--workers", str(job.workers), "--recorders", "1")
    settings = (*energy, *search_arguments(job.search), "--segmenter", job.segmenter)
    launcher.start(
        "coordinator", *source, "--bind", setup.endpoint, *expected, *settings, *setup.coordinator, *keys
    )
    launcher.start("limb_worker", *connect, *energy, *setup.limb_worker, *keys, copies=job.workers)
    for cameras in setup.segmentation:
        start_segmentation(launcher, job, setup.source, _from_here(setup.endpoint), cameras)
    results = ("--out", str(job.out), *output_arguments(job.output), *setup.recorder)
    launcher.start("recorder", *source, *connect, *results, *keys)
    if job.page is not None:
        page = ("--bind", job.page, "--results", str(job.out), *setup.viewer)
        launcher.start("viewer", *source, *connect, *page, *keys)


def start_segmentation(launcher: Launcher, job: Job, source: Path, endpoint: str, cameras: Arguments) -> None:
    """Start one process of segmentation; cameras: further arguments."""
    words = ("--take", str(source), "--connect", endpoint, "--segmenter", job.segmenter)
    launcher.start("segmentation", *words, *cameras, *_keys(job))


def _keys(job: Job) -> Arguments:
    return () if job.keys is None else ("--keys", str(job.keys))


def _from_here(endpoint: str) -> str:
    """The endpoint for processes on this machine if the coordinator listens at every address."""
    return re.sub(r"^tcp://(\*|0\.0\.0\.0):", "tcp://127.0.0.1:", endpoint)


def _follow(
    launcher: Launcher, job: Job, setup: RunSetup, stop: StopRequest, show: Callable[[Progress], None]
) -> Telemetry | None:
    """Watch until all is written, or a second stop is requested; returns the last telemetry."""
    ended_s, keys = dict[str, float](), keys_of_client(job.keys, "viewer")
    with closing(ProgressWatch(_from_here(setup.endpoint), keys, setup.first_frame)) as watch:
        while stop.count < 2:
            if launcher.is_done("recorder") and all(map(launcher.has_ended, setup.lasting)):
                break
            launcher.watch(over=SERVICES if "recorder" in ended_s else ())
            watch.listen(LOOK_S)
            progress = watch.progress(launcher.is_done("coordinator"))
            show(progress)
            for name in ("coordinator", "recorder"):
                if launcher.is_done(name):
                    ended_s.setdefault(name, time.monotonic())
            if stop.count:
                launcher.tell_to_stop("coordinator")
            if "coordinator" in ended_s:
                alone_s = time.monotonic() - ended_s["coordinator"]
                _end_without_coordinator(launcher, setup, stop, progress, alone_s)
            elif "recorder" in ended_s and time.monotonic() - ended_s["recorder"] > _LEAVE_S:
                break
        launcher.watch(over=SERVICES if launcher.is_done("recorder") else ())
    deadline_s = time.monotonic() + _CHECKS_S  # of all clean plates: after a few frames some may be left
    while not stop.count and time.monotonic() < deadline_s and not launcher.has_ended("segmentation"):
        time.sleep(_CHECKED_EVERY_S)
    return watch.telemetry


def _end_without_coordinator(
    launcher: Launcher, setup: RunSetup, stop: StopRequest, progress: Progress, alone_s: float
) -> None:
    """End what may still wait for the coordinator, which ended so long ago."""
    recorder_s = min(alone_s, launcher.up_s("recorder") - _STARTING_S)
    if recorder_s > setup.alone_s or (stop.count and not progress.has_poses):
        launcher.tell_to_stop("recorder")  # it writes what it has
    if stop.count and alone_s > _LEAVE_S:  # it may not have listened yet when the end was told
        launcher.tell_to_stop("segmentation")


def written_ns(folder: Path) -> int | None:
    """When a folder's results were written; None if there are none."""
    report = folder / RUN_JSON
    return report.stat().st_mtime_ns if report.exists() else None


def keep_logs(logs: Path, folder: Path) -> None:
    """Move the logs of a run to its results."""
    shutil.rmtree(folder / LOGS, ignore_errors=True)
    shutil.move(logs, folder / LOGS)
    (folder / LOGS).chmod(folder.stat().st_mode)  # a temporary folder is closed to others
