"""Recorder process: `python -m services.recorder --take TAKE --out DIR --connect tcp://HOST:5550`."""

import logging
import time
from pathlib import Path
from typing import Annotated

import typer
import zmq

from proto.framing import MalformedMessage
from proto.keys import ClientKeys
from proto.link import Line, Link
from proto.messages import Blob, BlobRequest, Hello, Message, Pose, PoseRequest, Recorded, TakeEnd, TakeInfo
from proto.sockets import receive, wait
from proto.streams import DEFAULT_ENDPOINT
from services.mocap.motion.settings import OutputSettings
from services.mocap.take.folder import open_take
from services.process import (
    DEFAULT_OUTPUT,
    CutoffOption,
    KeysOption,
    SmoothOption,
    StopRequest,
    client_name,
    keys_of_client,
    output_settings,
    run_service,
)
from services.recorder.collection import Collection
from services.recorder.result_folder import check_out
from services.recorder.results import write_results

_LOOK_S = 0.2
_ASK_AGAIN_S = 0.5
_GRACE_S = 1.5
"""How long after a stop the end of the take may take to arrive."""

log = logging.getLogger(__name__)


class Listener:
    """Listens to poses and asks for what is missing until the take is complete."""

    def __init__(self, take: str, endpoint: str, keys: ClientKeys | None = None) -> None:
        self._take = take
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._poses = Line(self._context, endpoint, "poses", keys)
        hello = Hello(role="recorder", name=client_name("recorder"), backend="")
        self._link = Link(self._context, endpoint, hello, keys)
        self._asked_s = 0.0
        self.collection = Collection()

    def listen(self) -> None:
        """Wait for messages a moment, take them in, and ask for what is missing."""
        wait([self._poses.socket, self._link.socket], _LOOK_S)
        try:
            while (message := receive(self._poses.socket)) is not None:
                self._take_in(message)
            while (message := self._link.receive()) is not None:
                self._take_in(message)
        except MalformedMessage as error:
            log.warning("dropped a malformed message: %s", error)
        self._poses.tick()
        self._link.tick()
        self._ask()

    def _take_in(self, message: Message) -> None:
        mine = isinstance(message, Blob) or getattr(message, "take", None) == self._take
        if mine and isinstance(message, TakeInfo | Pose | TakeEnd | Blob):
            self.collection.add(message)

    def _ask(self) -> None:
        if time.monotonic() - self._asked_s < _ASK_AGAIN_S:
            return
        self._asked_s = time.monotonic()
        for content in self.collection.missing_blobs():
            self._link.send(BlobRequest(hash=content))
        gap = self.collection.missing_frames()
        if gap is not None:
            self._link.send(PoseRequest(first_frame=gap[0], end_frame=gap[1]))

    def confirm(self) -> None:
        """Tell the coordinator that every frame is here."""
        self._link.send(Recorded(end_frame=self.collection.end_frame))

    def close(self) -> None:
        """Close the sockets, letting what was sent go out."""
        self._link.close()
        self._poses.close()
        self._context.term()


def serve(
    take_folder: Path,
    out: Path,
    endpoint: str,
    stop: StopRequest,
    overlay: bool,
    report: bool,
    output: OutputSettings,
    keys: ClientKeys | None = None,
) -> None:
    """Listen until the take is over, then write its results.

    After a stop the coordinator has a moment to end the take; then what is there is written. A second stop
    leaves the overlay out.
    """
    take = open_take(take_folder)
    check_out(out)
    listener = Listener(take.settings.name, endpoint, keys)
    log.info("ready, coordinator at %s", endpoint)
    stopped_s: float | None = None
    while not listener.collection.complete:
        if stop:
            stopped_s = stopped_s or time.monotonic()
            if time.monotonic() - stopped_s > _GRACE_S:
                break
        listener.listen()
    if listener.collection.complete:
        listener.confirm()
    listener.close()
    if listener.collection.poses:  # else the coordinator says why
        write_results(
            out,
            take,
            listener.collection,
            output,
            overlay=overlay,
            report=report,
            hurry=lambda: stop.count > 1,
        )


def main(
    take: Annotated[Path, typer.Option(help="The take folder.")],
    out: Annotated[Path, typer.Option(help="Where the results go.")],
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    overlay: Annotated[bool, typer.Option(help="Write overlay.mp4 too.")] = True,
    report: Annotated[bool, typer.Option(help="Write report.html too.")] = True,
    smooth: SmoothOption = DEFAULT_OUTPUT.smooth,
    cutoff_hz: CutoffOption = None,
    keys: KeysOption = None,
) -> None:
    """Record a take's poses and write its results."""

    def work(stop: StopRequest) -> None:
        own_keys = keys_of_client(keys, "recorder")
        serve(take, out, connect, stop, overlay, report, output_settings(smooth, cutoff_hz), own_keys)

    run_service("recorder", work)


if __name__ == "__main__":
    typer.run(main)
