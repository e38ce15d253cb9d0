"""Limb worker process: `python -m services.limb_worker --connect tcp://HOST:5550`."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
import zmq

from proto.keys import ClientKeys
from proto.link import Link
from proto.messages import Hello
from proto.streams import DEFAULT_ENDPOINT
from services.health import beat
from services.limb_worker.worker import Worker
from services.mocap.energy.engine import open_engine
from services.mocap.errors import UserError
from services.mocap.search.warm_up import warm_up
from services.options import (
    DEFAULT_ENGINE,
    KEYS_VARIABLE,
    BackendOption,
    MetricsOption,
    NiceOption,
    ThreadsOption,
    engine_settings,
    keys_of_client,
)
from services.process import StopRequest, client_name, give_way, run_service

log = logging.getLogger(__name__)


def _keys_for(endpoints: Sequence[str], folders: Sequence[Path]) -> list[ClientKeys | None]:
    """The keys for each coordinator, from one folder for all or one for each; raises UserError, KeysError."""
    if len(set(endpoints)) < len(endpoints):
        raise UserError(f"--connect {' '.join(endpoints)}: contains a coordinator twice: name each once")
    if len(folders) not in (0, 1, len(endpoints)):
        raise UserError(
            f"--keys: expected one folder, or one for each of {len(endpoints)} coordinators in their order, "
            f"got {len(folders)}"
        )
    keys = [keys_of_client(folder, "limb_worker") for folder in folders] or [None]
    return keys * len(endpoints) if len(keys) == 1 else keys


def main(
    connect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENDPOINT",
            envvar="XORMOCAP_CONNECT",
            help=f"A coordinator's endpoint ({DEFAULT_ENDPOINT}); repeat it for several, which are served "
            "in turn; in the environment separated by spaces.",
        ),
    ] = None,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    threads: ThreadsOption = DEFAULT_ENGINE.threads,
    keys: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            envvar=KEYS_VARIABLE,
            help="Folder with this worker's keys, made by xormocap keys; needed between machines. "
            "One for all coordinators, or one for each; in the environment separated by colons.",
        ),
    ] = None,
    metrics: MetricsOption = None,
    niceness: NiceOption = 0,
) -> None:
    """Solve limb tasks for coordinators until stopped."""
    endpoints = connect or [DEFAULT_ENDPOINT]

    def serve(stop: StopRequest) -> None:
        give_way(niceness)
        own_keys = _keys_for(endpoints, keys or [])
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        with open_engine(engine_settings(backend, threads)) as engine:
            warm_up(engine)
            log.info("%s", engine)
            hello = Hello(role="limb_worker", name=client_name("limb_worker"), backend=engine.name)
            places = zip(endpoints, own_keys, strict=True)
            links = [Link(context, endpoint, hello, own) for endpoint, own in places]
            worker = Worker(links, engine)
            log.info("ready, coordinator at %s", ", ".join(endpoints))
            while not stop:
                beat()
                worker.listen()
                worker.work()
                worker.tick()
            for link in links:
                link.close(linger_ms=0)  # a task whose result was not sent is solved again
        context.term()

    run_service("limb_worker", serve, metrics)


if __name__ == "__main__":
    typer.run(main)
