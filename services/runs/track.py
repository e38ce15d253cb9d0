"""Tracking a take with local processes: what `xormocap track` does."""

import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from services.mocap.atomic import atomic_folder
from services.mocap.export.formats import write_defaults
from services.mocap.result.layout import CORRECTED_FRAMES, LOGS, partial_of
from services.mocap.result.result import edited_run, load_result
from services.mocap.take.actor_file import take_actor
from services.mocap.take.fit_record import FIT_FOLDER, record_of
from services.mocap.take.folder import Take
from services.mocap.verdict.judging import CHECKS
from services.mocap.verdict.verdict import Cause
from services.runs import Interrupted, ServiceFailedError
from services.runs.launcher import Launcher, free_endpoint
from services.runs.local_run import Job, RunSetup, keep_logs, run_services, written_ns
from services.runs.progress import Progress
from services.segmentation.segmenters import chosen_segmenter


@dataclass(frozen=True, kw_only=True)
class TakeJob(Job):
    """What take to track, and how."""

    take: Take
    """Checked."""
    frames: range
    overlay: bool
    fitted: Path | None = None
    """A folder of xormocap fit, used instead of the take's actor and poses; copied to out/fit."""
    kept: Path | None = None
    """A folder for silhouettes, and for what was learnt for them, if the take is tracked again: each is made
    only once; see make_segmenter."""
    endpoint: str | None = None
    """Where the coordinator listens; None: at free ports."""
    checks: tuple[Cause, ...] = ()
    """What is wrong with the take, as far as the checks before the run found it; the verdict tells it."""


def track(
    job: TakeJob,
    *,
    show: Callable[[Progress], None],
    warn: Callable[[str], None] = lambda _: None,
    started: Callable[[Launcher], None] = lambda _: None,
) -> dict[str, Any]:
    """Do a job and return its run.json, which includes the actor's fit; the logs go to out/logs.

    show, warn, started, and what is raised: as run_services. Raises Interrupted once a stop was asked for and
    what was done by then is written.
    """
    with tempfile.TemporaryDirectory(prefix="xormocap-run-") as temporary:
        setup = _setup(job, Path(temporary) / "known.json")
        earlier = {folder: written_ns(folder) for folder in (job.out, partial_of(job.out))}
        logs, was_stopped, _ = run_services(job, setup, show, warn, started)
    folder = next((f for f, before in earlier.items() if written_ns(f) != before), None)
    if folder is not None:
        report = _completed(folder, job)
        keep_logs(logs, folder)
        write_defaults(folder, load_result(folder), ("report",), warn)
        is_settled = CORRECTED_FRAMES in report or not job.search.goes_both_ways
        if is_settled and report["take"]["frames"] == len(job.frames):
            return report
    if was_stopped:
        shutil.rmtree(logs, ignore_errors=True)
        raise Interrupted(folder)
    where = logs if folder is None else folder / LOGS
    raise ServiceFailedError(f"the run ended before its last frame was final; the logs are in {where}")


def _setup(job: TakeJob, known: Path) -> RunSetup:
    """The setup of a job; known: where the further entries of run.json are written."""
    fitted, frames = job.fitted, job.frames
    actor = take_actor(job.take, fitted)
    entries: dict[str, Any] = {CHECKS: [cause.model_dump() for cause in job.checks]}
    fit_folder = fitted or job.take.folder / FIT_FOLDER
    if (record := record_of(fit_folder, actor)) is not None:
        entries["fit"] = record.model_dump()
    known.write_text(json.dumps(entries), encoding="utf-8")
    asked = ("--frames", f"{frames.start}:{frames.stop}")
    with_fit = () if fitted is None else ("--fitted", str(fitted))
    kept = () if job.kept is None else ("--kept", str(job.kept))
    overlay = "--overlay" if job.overlay else "--no-overlay"
    return RunSetup(
        source=job.take.folder,
        endpoint=job.endpoint or free_endpoint(),
        coordinator=(*asked, *with_fit),
        # The report comes with the fit's pictures and the segmenter's name.
        recorder=(overlay, "--no-report", "--known", str(known), *with_fit),
        viewer=with_fit,
        segmentation=[(*with_fit, *kept)],
        actor=actor,
        first_frame=frames.start,
        lasting=("coordinator",),
        alone_s=2.0,
    )


def _completed(folder: Path, job: TakeJob) -> dict[str, Any]:
    """The run.json of a folder of results, which gets a copy of the files of its fit, if this run has one."""
    with edited_run(folder) as report:
        report["settings"]["segmenter"] = chosen_segmenter(job.take, job.segmenter)
        is_its_fit = "fit" in report
    if is_its_fit and job.fitted is not None:
        copy = folder / f".{FIT_FOLDER}"
        shutil.rmtree(copy, ignore_errors=True)
        with atomic_folder(copy) as part:
            shutil.copytree(job.fitted, part, dirs_exist_ok=True)
            part.chmod(folder.stat().st_mode)  # a temporary folder is closed to others
        shutil.rmtree(folder / FIT_FOLDER, ignore_errors=True)
        copy.replace(folder / FIT_FOLDER)
    return report
