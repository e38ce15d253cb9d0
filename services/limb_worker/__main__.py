"""Limb worker process: `python -m services.limb_worker --connect tcp://HOST:5550`."""

import logging
from typing import Annotated

import typer
import zmq

from proto.framing import MalformedMessage
from proto.keys import ClientKeys
from proto.link import Link
from proto.messages import Blob, BlobRequest, Hello, LimbRefusal, LimbTask, Message
from proto.sockets import wait
from proto.streams import DEFAULT_ENDPOINT
from services.limb_worker.metrics import DROPPED, WAITING, note_answer
from services.limb_worker.solver import LimbSolver, UnusableBlobError
from services.mocap.energy.engine import Engine, open_engine
from services.mocap.search.warm_up import warm_up
from services.process import (
    DEFAULT_ENGINE,
    BackendOption,
    KeysOption,
    MetricsOption,
    StopRequest,
    ThreadsOption,
    about,
    client_name,
    engine_settings,
    keys_of_client,
    run_service,
)

_LOOK_S = 0.2
"""How long to wait for messages before looking after beats and a request to stop."""
_TASKS_HELD = 8
"""Tasks that wait for content, at most."""

log = logging.getLogger(__name__)


class Worker:
    """Takes tasks from a link, asks for what they lack, and sends back what it finds."""

    def __init__(self, link: Link, engine: Engine) -> None:
        self._link, self._solver = link, LimbSolver(engine)
        self._waiting: list[LimbTask] = []

    def handle(self, message: Message) -> None:
        """Act on one message."""
        if isinstance(message, LimbTask):
            self._waiting = [*self._waiting, message][-_TASKS_HELD:]
            self._ask_for(message)
        elif isinstance(message, Blob):
            try:
                self._solver.store(message)
            except UnusableBlobError as error:
                log.warning("unusable content: %s", error)
            if message.kind == "actor":  # it may name a mesh
                for task in self._waiting:
                    self._ask_for(task)
        self._solve_ready()

    def _ask_for(self, task: LimbTask) -> None:
        for content in self._solver.missing(task):
            self._link.send(BlobRequest(hash=content))

    def _solve_ready(self) -> None:
        ready = [task for task in self._waiting if not self._solver.missing(task)]
        self._waiting = [task for task in self._waiting if self._solver.missing(task)]
        WAITING.set(len(self._waiting))
        for task in ready:
            about(take=task.take, frame=task.frame, limb=task.limb, **{"pass": task.pass_index})
            answer = self._solver.solve(task)
            if isinstance(answer, LimbRefusal):
                log.warning("refused a task: %s", answer.reason)
            note_answer(answer)
            self._link.send(answer)


def serve(endpoint: str, engine: Engine, stop: StopRequest, keys: ClientKeys | None = None) -> None:
    """Solve limb tasks until asked to stop."""
    warm_up(engine)
    log.info("%s", engine)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    hello = Hello(role="limb_worker", name=client_name("limb_worker"), backend=engine.name)
    link = Link(context, endpoint, hello, keys)
    worker = Worker(link, engine)
    log.info("ready, coordinator at %s", endpoint)
    while not stop:
        wait([link.socket], _LOOK_S)
        try:
            while (message := link.receive()) is not None:
                worker.handle(message)
        except MalformedMessage as error:
            DROPPED.inc()
            log.warning("dropped a malformed message: %s", error)
        link.tick()
    link.close()
    context.term()


def main(
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    threads: ThreadsOption = DEFAULT_ENGINE.threads,
    keys: KeysOption = None,
    metrics: MetricsOption = None,
) -> None:
    """Solve limb tasks for a coordinator until stopped."""

    def start(stop: StopRequest) -> None:
        own_keys = keys_of_client(keys, "limb_worker")
        with open_engine(engine_settings(backend, threads)) as engine:
            serve(connect, engine, stop, own_keys)

    run_service("limb_worker", start, metrics)


if __name__ == "__main__":
    typer.run(main)
