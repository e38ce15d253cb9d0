"""Tracking live cameras: what `xormocap live` does."""

import json
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proto.messages import Telemetry
from services.mocap.atomic import atomic_file
from services.mocap.energy.settings import EngineSettings
from services.mocap.motion.settings import OutputSettings
from services.mocap.result.layout import LOGS, RUN_JSON, partial_of
from services.mocap.search.settings import SearchSettings
from services.mocap.take.live import LiveTake
from services.mocap.take.live_recording import begin_recording, finish_recording
from services.options import engine_arguments, output_arguments, search_arguments
from services.runs.failures import ServiceFailedError
from services.runs.launcher import SERVICES, Launcher, free_endpoint, kinds_of_run
from services.runs.live_watch import LiveProgress, LiveWatch
from services.runs.track import StopSignals

_LOOK_S = 0.2
_TOLD = ("segmentation", "coordinator", "recorder")
_NICENESS = 5
"""Of what tracks: cameras do not wait, so their pictures go first where cores are few."""
_ALONE_S = 15.0
"""How long after the coordinator's end a recorder that still waits for it is left waiting."""


@dataclass(frozen=True)
class LiveJob:
    """What to track live, and how."""

    config: Path
    take: LiveTake
    out: Path
    """The folder of the results."""
    workers: int
    engine: EngineSettings
    search: SearchSettings
    output: OutputSettings
    segmenter: str
    page: str | None
    """Where browsers can watch, as HOST:PORT; None: nowhere."""
    record: Path | None
    """Where the pictures go as a take; None: nowhere."""
    keys: Path | None
    """The folder that xormocap keys made, where the coordinator listens beyond this machine."""


def live(
    job: LiveJob,
    *,
    show: Callable[[LiveProgress], None],
    warn: Callable[[str], None] = lambda _: None,
    started: Callable[[Launcher], None] = lambda _: None,
) -> dict[str, Any] | None:
    """Track live until a stop is asked for or all sources are files that are over; returns run.json.

    None where no pose was found. warn is called with each warning of the services at the end; started once
    with the launcher when all processes run. Raises UserError, or ServiceFailedError, after which the logs
    stay.
    """
    endpoint = job.take.live.endpoint or free_endpoint()
    logs = Path(tempfile.mkdtemp(prefix="xormocap-logs-"))
    recording = None if job.record is None else begin_recording(job.record)
    shutil.rmtree(partial_of(job.out), ignore_errors=True)  # nobody goes on with live input that is over
    before_ns = _written_ns(job.out)
    try:
        with StopSignals() as stop, Launcher(logs, kinds_of_run(job.page)) as launcher:
            _start(launcher, job, endpoint, recording)
            started(launcher)
            told = _follow(launcher, endpoint, job.keys, stop, show)
            for sentence in (sentence for service in _TOLD for sentence in launcher.warnings(service)):
                warn(sentence)
    except ServiceFailedError as error:
        raise ServiceFailedError(f"{error}; the logs are in {logs}") from None
    if job.record is not None:
        away = finish_recording(job.take, job.record)
        if away:
            warn(f"{job.record}: lacks {', '.join(away)}: copy what --record wrote on their hosts into it")
    if _written_ns(job.out) == before_ns:
        shutil.rmtree(logs, ignore_errors=True)
        return None
    shutil.rmtree(job.out / LOGS, ignore_errors=True)
    shutil.move(logs, job.out / LOGS)
    return _completed(job, told)


def _written_ns(folder: Path) -> int | None:
    report = folder / RUN_JSON
    return report.stat().st_mtime_ns if report.exists() else None


def _completed(job: LiveJob, told: Telemetry | None) -> dict[str, Any]:
    """The run.json of the results, in which the drops of every camera now are."""
    report: dict[str, Any] = json.loads((job.out / RUN_JSON).read_text())
    report["settings"]["segmenter"] = job.segmenter
    if told is not None:
        names = ("source", "segmentation", "tracking")
        drops = {camera: dict(zip(names, counts, strict=True)) for camera, counts in told.drops.items()}
        report["live"]["drops"] = drops
    with atomic_file(job.out / RUN_JSON) as part:
        part.write_text(json.dumps(report, indent=2) + "\n")
    return report


def _start(launcher: Launcher, job: LiveJob, endpoint: str, recording: Path | None) -> None:
    """Start all processes of a job, but for those of groups that other hosts serve."""
    here, keys = _from_here(endpoint), _keys(job)
    source, connect_to = ("--take", str(job.config)), ("--connect", here)
    expected = ("--workers", str(job.workers), "--recorders", "1")
    energy, nice = engine_arguments(job.engine), ("--nice", str(_NICENESS))
    for group, cameras in job.take.groups().items():
        if group not in job.take.live.elsewhere:
            _start_group(launcher, job, cameras, here, recording)
    wanted = (*expected, *energy, *search_arguments(job.search), "--segmenter", job.segmenter, *nice, *keys)
    launcher.start("coordinator", *source, "--bind", endpoint, *wanted)
    launcher.start("limb_worker", *connect_to, *energy, *nice, *keys, copies=job.workers)
    out = ("--out", str(job.out), "--no-overlay", *output_arguments(job.output), *keys)
    launcher.start("recorder", *source, *connect_to, *out)
    if job.page is not None:
        launcher.start("viewer", *source, *connect_to, "--bind", job.page, "--results", str(job.out), *keys)


def _start_group(
    launcher: Launcher, job: LiveJob, cameras: list[int], endpoint: str, recording: Path | None
) -> None:
    """Start the segmentation of a group of cameras on this host."""
    names = ",".join(job.take.cameras[c].name for c in cameras)
    record = () if recording is None else ("--record", str(recording))
    launcher.start(
        "segmentation",
        *("--take", str(job.config), "--cameras", names, "--connect", endpoint, "--segmenter", job.segmenter),
        *(*_keys(job), *record),
    )


def _keys(job: LiveJob) -> tuple[str, ...]:
    return () if job.keys is None else ("--keys", str(job.keys))


def _follow(
    launcher: Launcher,
    endpoint: str,
    keys: Path | None,
    stop: StopSignals,
    show: Callable[[LiveProgress], None],
) -> Telemetry | None:
    """Watch until all is written, or a second stop is asked for; returns the last telemetry."""
    watch, ended_s = LiveWatch(_from_here(endpoint), keys), float("inf")
    try:
        while stop.count < 2 and not _is_over(launcher):
            launcher.watch(over=SERVICES if launcher.is_done("recorder") else ())
            show(watch.look())
            if stop.count:
                launcher.tell_to_stop("coordinator")
            if launcher.is_done("coordinator"):
                ended_s = min(ended_s, time.monotonic())
            if time.monotonic() - ended_s > _ALONE_S:
                launcher.tell_to_stop("recorder")
        launcher.watch(over=SERVICES if launcher.is_done("recorder") else ())
    finally:
        watch.close()
    return watch.told


def _from_here(endpoint: str) -> str:
    """Where processes on this machine find a coordinator that listens at every address."""
    return re.sub(r"^tcp://(\*|0\.0\.0\.0):", "tcp://127.0.0.1:", endpoint)


def _is_over(launcher: Launcher) -> bool:
    """Whether poses and pictures are all on disk."""
    return launcher.is_done("recorder") and all(
        launcher.has_ended(name) for name in ("coordinator", "segmentation")
    )


def serve_group(job: LiveJob, group: str, endpoint: str) -> None:
    """Serve one group of cameras on this host until its segmentation ends or a stop is asked for."""
    recording = None if job.record is None else begin_recording(job.record)
    with (
        tempfile.TemporaryDirectory(prefix="xormocap-logs-") as logs,
        StopSignals() as stop,
        Launcher(Path(logs), ["segmentation"]) as launcher,
    ):
        _start_group(launcher, job, job.take.groups()[group], endpoint, recording)
        while not stop.count and not launcher.has_ended("segmentation"):
            launcher.watch()
            time.sleep(_LOOK_S)
    if recording is not None and job.record is not None:
        recording.rename(job.record.resolve())
