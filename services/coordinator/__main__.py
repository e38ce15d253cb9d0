"""Coordinator process: `python -m services.coordinator --take TAKE --bind tcp://127.0.0.1:5550`."""

import logging
import signal
from pathlib import Path
from typing import Annotated

# SIGHUP may arrive before there is a handler, because imports take a second. A process that imports this
# module for others handles the signal itself.
# ruff: noqa: E402
_default_hangup = signal.getsignal(signal.SIGHUP)
if __name__ == "__main__":
    signal.signal(signal.SIGHUP, signal.SIG_IGN)

import typer

from proto.auth import Admission
from proto.streams import DEFAULT_ENDPOINT
from services.coordinator.plan import Plan
from services.coordinator.session import Session
from services.mocap.energy.engine import check_cost, open_engine
from services.mocap.search.overrides import search_settings
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import take_actor
from services.mocap.take.fit_record import FIT_FOLDER, known_poses, read_learnt
from services.mocap.take.folder import Take
from services.mocap.take.live import LiveTake, open_source
from services.mocap.take.moved_cameras import take_of_fit
from services.options import (
    DEFAULT_ENGINE,
    DEFAULT_SEGMENTER,
    BackendOption,
    BodyOption,
    FittedOption,
    FramesOption,
    KeysOption,
    MetricsOption,
    NiceOption,
    SearchOption,
    SegmenterOption,
    SetOption,
    SettingsOption,
    ThreadsOption,
    engine_settings,
)
from services.process import StopRequest, give_way, run_service

log = logging.getLogger(__name__)


def main(
    take: Annotated[Path, typer.Option(help="The take folder, or a live configuration.")],
    bind: Annotated[str, typer.Option(help="Address to listen on.")] = DEFAULT_ENDPOINT,
    frames: FramesOption = ":",
    workers: Annotated[int, typer.Option(min=0, help="Limb workers to wait for before the first frame.")] = 0,
    recorders: Annotated[int, typer.Option(min=0, help="Recorders to wait for before the first frame.")] = 0,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    threads: ThreadsOption = DEFAULT_ENGINE.threads,
    preset: SearchOption = "default",
    body: BodyOption = None,
    changes: SetOption = None,
    settings: SettingsOption = None,
    fitted: FittedOption = None,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    keys: KeysOption = None,
    metrics: MetricsOption = None,
    niceness: NiceOption = 0,
) -> None:
    """Track a take with the connected limb workers."""

    def serve(stop: StopRequest) -> None:
        give_way(niceness)
        admission = None if keys is None else Admission(keys)
        if admission is None:
            signal.signal(signal.SIGHUP, _default_hangup)
        else:
            hung_up = admission.ask_again
            signal.signal(signal.SIGHUP, lambda *_: hung_up())
            hung_up()  # the list may have changed just before the handler was installed
        opened = take_of_fit(open_source(take), fitted)
        engine_choice = engine_settings(backend, threads)
        search = search_settings(changes or [], settings, len(opened.cameras), preset, body)
        check_cost(engine_choice, search.cost)
        plan = _plan(opened, opened.frame_range(frames), search, segmenter, fitted)
        with open_engine(engine_choice) as engine:
            log.info("%s", engine)
            Session(plan, engine, bind, stop, admission).run(workers, recorders)

    run_service("coordinator", serve, metrics)


def _plan(take: Take, frames: range, search: SearchSettings, segmenter: str, fitted: Path | None) -> Plan:
    """The plan of the session, with the results of a fit from its own folder or from the take."""
    actor = take_actor(take, fitted)
    # A fit's poses are of other frames than live ones; segmentation reads what the fit learnt of colours.
    if actor is None or isinstance(take, LiveTake):
        return Plan(take, frames, search, segmenter, actor)
    fit_folder = fitted or take.folder / FIT_FOLDER
    poses = known_poses(fit_folder, actor, take.settings)
    log.info("poses of %d frames are known from the fit of the actor", len(poses))
    return Plan(take, frames, search, segmenter, actor, poses, *read_learnt(fit_folder, take.cameras))


if __name__ == "__main__":
    typer.run(main)
