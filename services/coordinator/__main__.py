"""Coordinator process: `python -m services.coordinator --take TAKE --bind tcp://127.0.0.1:5550`."""

import logging
from pathlib import Path
from typing import Annotated

import typer

from proto.streams import DEFAULT_ENDPOINT
from services.coordinator.session import Plan, Session
from services.mocap.energy.engine import open_engine
from services.mocap.search.overrides import search_settings
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import open_take
from services.mocap.take.frame_range import frame_range
from services.process import (
    DEFAULT_ENGINE,
    BackendOption,
    SetOption,
    SettingsOption,
    StopRequest,
    ThreadsOption,
    engine_settings,
    run_service,
)

_CLIENTS_S = 60.0
"""How long to wait for the expected workers and recorder before going on with those that are there."""

log = logging.getLogger(__name__)


def main(
    take: Annotated[Path, typer.Option(help="The take folder.")],
    bind: Annotated[str, typer.Option(help="Where to listen.")] = DEFAULT_ENDPOINT,
    frames: Annotated[str, typer.Option(help="Which frames, A up to but not including B, as A:B.")] = ":",
    workers: Annotated[int, typer.Option(min=0, help="Limb workers to wait for before the first frame.")] = 0,
    recorders: Annotated[int, typer.Option(min=0, help="Recorders to wait for before the first frame.")] = 0,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    threads: ThreadsOption = DEFAULT_ENGINE.threads,
    changes: SetOption = None,
    settings: SettingsOption = None,
) -> None:
    """Track a take with the limb workers that are there."""

    def serve(stop: StopRequest) -> None:
        opened = open_take(take)
        search = search_settings(changes or [], settings, len(opened.cameras))
        plan = Plan(opened, frame_range(frames, opened), search, take_actor(opened))
        with open_engine(engine_settings(backend, threads)) as engine:
            log.info("%s", engine)
            session = Session(plan, engine, bind, stop)
            session.await_clients(workers, recorders, _CLIENTS_S)
            session.run()

    run_service("coordinator", serve)


if __name__ == "__main__":
    typer.run(main)
