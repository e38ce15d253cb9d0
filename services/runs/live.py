"""Tracking live cameras: what `xormocap live` does."""

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proto.messages import DROPPED_BY
from services.logs import NOT_YET
from services.mocap.errors import UserError
from services.mocap.result.layout import partial_of
from services.mocap.result.result import edited_run
from services.mocap.take.actor_file import read_actor
from services.mocap.take.fit_record import FIT_FOLDER, copy_learnt, record_of, was_seen_by
from services.mocap.take.live import LiveTake
from services.mocap.take.live_recording import finish_recording, part_of, recording_to
from services.process import StopRequest
from services.runs.fork_server import lines_of
from services.runs.launcher import Launcher, free_endpoint
from services.runs.local_run import (
    LOOK_S,
    Arguments,
    Job,
    RunSetup,
    keep_logs,
    run_services,
    start_segmentation,
    written_ns,
)  # fmt: skip
from services.runs.progress import Progress

_NICENESS = 5
"""Niceness of the tracking processes: cameras do not wait, so their pictures have priority on few cores."""


@dataclass(frozen=True, kw_only=True)
class LiveJob(Job):
    """What to track live, and how."""

    config: Path
    take: LiveTake
    record: Path | None = None
    """Folder to record the pictures in as a take; None: no recording."""
    fit: Path | None = None
    """See fit_of_actor."""


def live(
    job: LiveJob,
    *,
    show: Callable[[Progress], None],
    warn: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Track live until a stop is requested or all sources are files that have ended; returns run.json.

    show, warn, and what is raised: as run_services; UserError, too, where no pose was found, or where the
    run was cut off and its results lie beside earlier ones.
    """
    cut_off = partial_of(job.out)
    shutil.rmtree(cut_off, ignore_errors=True)  # live input cannot be continued
    nice = ("--nice", str(_NICENESS))
    before_ns = written_ns(job.out)
    with recording_to(job.record), _stage_folder(job) as stage:
        setup = RunSetup(
            source=job.config,
            endpoint=job.take.live.endpoint or free_endpoint(),
            coordinator=nice,
            limb_worker=nice,
            recorder=("--no-overlay",),
            segmentation=[_cameras(job, group, stage) for group in job.take.groups_here],
            lasting=("coordinator", "segmentation"),
            alone_s=15.0,
        )
        logs, _, telemetry = run_services(job, setup, show, warn)
    if written_ns(cut_off) is not None:
        keep_logs(logs, cut_off)
        said = f"{cut_off}: has the results of this run, which was cut off: move them before the next run, "
        said += f"which removes them; {job.out} keeps the earlier ones"
        raise _error_after_recording(job, said, warn)
    if written_ns(job.out) == before_ns:
        if telemetry is not None and telemetry.next_frame > telemetry.first_frame:
            said = f"{job.out}: no results were written, although poses came: the logs are in {logs}"
            raise _error_after_recording(job, said, warn)
        raise _without_pose(job, logs, warn)
    keep_logs(logs, job.out)
    if job.fit is not None and job.fit.exists():  # it may have been that of the results that were replaced
        copy_learnt(job.fit, job.out / FIT_FOLDER)
    with edited_run(job.out) as report:
        report["settings"]["segmenter"] = job.segmenter
        if telemetry is not None:
            drops = {
                cam: dict(zip(DROPPED_BY, counts, strict=True)) for cam, counts in telemetry.drops.items()
            }
            report["live"]["drops"] = drops
            if "settled_median" in (latency_s := telemetry.latency_s):
                settled_s = {which: latency_s[f"settled_{which}"] for which in ("median", "p95")}
                report["live"]["settled_latency_s"] = settled_s
    _finish_recording(job, warn)
    return report


def _without_pose(job: LiveJob, logs: Path, warn: Callable[[str], None]) -> UserError:
    """What a run without a pose tells; its logs are left if the reason is not known."""
    if reason := _no_pose_reason(logs):
        shutil.rmtree(logs, ignore_errors=True)
    said = f"{job.config}: nobody was tracked: {reason or f'the logs are in {logs}'}"
    return _error_after_recording(job, said, warn)


def _error_after_recording(job: LiveJob, said: str, warn: Callable[[str], None]) -> UserError:
    """An error that says something, and what else is wrong with the recording, which is finished first."""
    try:
        _finish_recording(job, warn)
    except UserError as problem:
        said += f"; {problem}"
    return UserError(said)


def _no_pose_reason(logs: Path) -> str | None:
    """Why the coordinator found no first pose, if its log says so."""
    lines = lines_of(logs / "coordinator-0.log")
    return next((line.partition(NOT_YET)[2] for line in reversed(lines) if NOT_YET in line), None)


def _finish_recording(job: LiveJob, warn: Callable[[str], None]) -> None:
    """Make a take of what was recorded; raises as finish_recording."""
    if job.record is None:
        return
    if not part_of(job.record).exists():
        warn(f"{job.record}: no picture came, so nothing was recorded")
    elif away := finish_recording(job.take, job.record):
        warn(f"{job.record}: lacks {', '.join(away)}: copy the recordings from their hosts into it")


@contextmanager
def _stage_folder(job: LiveJob) -> Iterator[Path]:
    """A folder for the pictures of the empty stage, which are left for a segmentation that is restarted."""
    if job.record is not None:
        yield part_of(job.record)
        return
    with tempfile.TemporaryDirectory(prefix="xormocap-stage-") as folder:
        yield Path(folder)


def _cameras(job: LiveJob, group: str, stage: Path) -> Arguments:
    """Which cameras one process segments, what is known of them, and where it keeps what they see."""
    names = ",".join(job.take.cameras[c].name for c in job.take.cameras_of([group]))
    folders = {"--fitted": job.fit, "--record": job.record and part_of(job.record), "--stage": stage}
    given = [word for option, folder in folders.items() if folder for word in (option, str(folder))]
    return ("--cameras", names, *given)


def fit_of_actor(take: LiveTake) -> Path | None:
    """The folder of the fit that found the take's actor with these very cameras, if any: it knows what hides
    the actor, and the actor's colours. Raises TakeError if the actor or the fit's record cannot be used."""
    path = take.actor_path
    if path is None or not path.exists():  # a host that serves a group of cameras may lack it
        return None
    actor = read_actor(path)
    for folder in (path.parent / FIT_FOLDER, path.parent):
        record = record_of(folder, actor)
        if record is not None and was_seen_by(record, take.calibrated):
            return folder
    return None


def serve_group(job: LiveJob, group: str) -> None:
    """Serve one group of cameras on this host until its segmentation ends or a stop is requested.

    Raises UserError if the configuration does not say where the coordinator is.
    """
    endpoint = job.take.live.endpoint
    if endpoint is None:
        raise UserError(f"--group: {job.config} does not say where the coordinator is: add endpoint to it")
    with (
        recording_to(job.record),
        _stage_folder(job) as stage,
        tempfile.TemporaryDirectory(prefix="xormocap-logs-") as logs,
        StopRequest() as stop,
        Launcher(Path(logs), ["segmentation"]) as launcher,
    ):
        start_segmentation(launcher, job, job.config, endpoint, _cameras(job, group, stage))
        while not stop.count:
            launcher.watch()
            if launcher.is_done("segmentation"):
                break
            time.sleep(LOOK_S)
    if job.record is not None and part_of(job.record).exists():
        part_of(job.record).rename(job.record.resolve())
