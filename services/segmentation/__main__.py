"""Segmentation process: `python -m services.segmentation --take TAKE --connect tcp://HOST:5550`."""

import logging
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
import zmq

from proto.keys import ClientKeys
from proto.link import Line
from proto.messages import Credit, Message, Silhouettes, TakeEnd
from proto.sockets import wait
from proto.streams import DEFAULT_ENDPOINT, RESEND_S
from services.health import beat
from services.listener import hear
from services.logs import about
from services.mocap.camera.camera import nfc
from services.mocap.camera.rig import Rig
from services.mocap.errors import UserError, nearest
from services.mocap.take.actor_file import take_actor
from services.mocap.take.fit_record import FIT_FOLDER, read_learnt, record_of
from services.mocap.take.folder import Take
from services.mocap.take.live import LiveTake, open_source
from services.mocap.take.moved_cameras import take_of_fit
from services.options import DEFAULT_SEGMENTER, KeysOption, MetricsOption, SegmenterOption, keys_of_client
from services.process import STOP_CHECK_S, StopRequest, run_service
from services.segmentation.live.serving import serve_live
from services.segmentation.metrics import CREDIT, FRAMES, SECONDS
from services.segmentation.segmenters import PlateCheck, make_segmenter
from services.segmentation.silhouettes import Moment, packed

log = logging.getLogger(__name__)


class Sender:
    """Sends the silhouettes of some cameras of a recorded take as far as the coordinator's credit goes."""

    def __init__(
        self,
        take: Take,
        cameras: list[int],
        segmenter: str,
        endpoint: str,
        keys: ClientKeys | None,
        fitted: Path | None = None,
        kept: Path | None = None,
    ) -> None:
        """fitted: the folder of the actor's fit, by default the take's own; what its occluded pictures show
        is unsure, and it knows the actor's colour classes. kept: see make_segmenter."""
        self._take, self._cameras = take, cameras
        self._height, self._width = Rig.of(take.cameras).shape_px
        self._checks = deque[PlateCheck]()
        chosen = [take.cameras[c] for c in cameras]
        made = make_segmenter(take, chosen, segmenter, self._checks.append, kept)
        fit_folder = fitted or take.folder / FIT_FOLDER
        if record_of(fit_folder, take_actor(take, fitted)) is not None:
            made = made.knowing(*read_learnt(fit_folder, chosen))
        self._segmenter = made
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._silhouettes = Line(self._context, endpoint, "silhouettes", keys)
        self._poses = Line(self._context, endpoint, "poses", keys)
        self._credit: Credit | None = None
        self._is_over = False
        self._run, self._next = "", 0
        self._moments: Iterator[Moment] | None = None
        self._unsent: Silhouettes | None = None
        self._advanced_s = time.monotonic()
        log.info("ready: %s from %s", ", ".join(camera.name for camera in chosen), take.source)

    def run(self, stop: StopRequest) -> None:
        """Follow the credit until the coordinator says that the take is over; between frames check plates."""
        while not stop:
            hear(self._poses, self._take_in)
            if self._is_over:
                break
            beat()
            if not self._send_next():
                self._check_a_plate()
                wait([self._poses.socket], 0.0 if self._checks else STOP_CHECK_S)
            if any([self._silhouettes.tick(), self._poses.tick()]):
                self._moments = None  # what was sent to another connection may be lost with it
        while not stop and self._checks:  # a take that is over before all plates were checked
            beat()
            self._check_a_plate()

    def close(self) -> None:
        """Close the connections after sending what is queued."""
        self._silhouettes.close()
        self._poses.close()
        self._context.term()

    def _check_a_plate(self) -> None:
        if self._checks:
            self._checks.popleft()()

    def _take_in(self, message: Message) -> None:
        """Follow the credit for this take until its end."""
        name = self._take.settings.name
        if isinstance(message, TakeEnd) and message.take == name:
            self._is_over = True
        elif isinstance(message, Credit) and message.take == name and not self._is_over:
            CREDIT.set(max(message.end_frame - self._next, 0))
            self._follow(message)

    def _follow(self, credit: Credit) -> None:
        """Go on where the coordinator is: behind (it was restarted), ahead, or in another run."""
        self._credit = credit
        stalled = credit.next_frame < self._next and time.monotonic() - self._advanced_s > RESEND_S
        is_other = credit.run != self._run
        if self._moments is None or stalled or is_other or credit.next_frame > self._next:
            self._run, self._next, self._unsent = credit.run, credit.next_frame, None
            end_frame = self._take.settings.frames
            self._moments = self._segmenter.moments(self._next, end_frame, with_pictures=False)
            self._advanced_s = time.monotonic()

    def _send_next(self) -> bool:
        """Send one frame if credit allows; False if there is nothing to do at the moment."""
        if self._credit is None:
            return False
        if self._unsent is None:
            if self._moments is None or self._next >= min(self._credit.end_frame, self._take.settings.frames):
                return False
            about(frame=self._next)
            with SECONDS.time():
                moment = next(self._moments)
                planes = packed(moment.trimaps, self._width, self._height, moment.classes)
            self._unsent = Silhouettes(
                take=self._take.settings.name,
                run=self._run,
                frame=self._next,
                cameras=self._cameras,
                planes=planes.silhouettes,
                unsure=planes.sent_unsure,
                classes=planes.sent_classes,
            )
        if not self._silhouettes.send(self._unsent):
            return False
        FRAMES.inc()
        self._next, self._unsent = self._next + 1, None
        self._advanced_s = time.monotonic()
        return True


def _choose(take: Take, names: str) -> list[int]:
    """Camera indices from names separated by commas, each once; empty: all."""
    known = take.camera_names
    wanted = list(dict.fromkeys(nfc(name.strip()) for name in names.split(",") if name.strip())) or known
    for name in wanted:
        if name not in known:
            raise UserError(f"--cameras {name}: {take.folder} has no such camera: {nearest(name, known)}")
    return [known.index(name) for name in wanted]


def main(
    take: Annotated[Path, typer.Option(help="The take folder, or a live configuration.")],
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    cameras: Annotated[str, typer.Option(help="Cameras to serve, separated by commas; all by default.")] = "",
    keys: KeysOption = None,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    metrics: MetricsOption = None,
    fitted: Annotated[
        Path | None,
        typer.Option(help="A folder of xormocap fit: what it learnt of hidden pixels and of colours."),
    ] = None,
    kept: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the silhouettes of one take and segmenter, and what was learnt for them."
        ),
    ] = None,
    record: Annotated[Path | None, typer.Option(help="Live: folder to record the pictures in.")] = None,
    stage: Annotated[
        Path | None,
        typer.Option(help="Live: folder for the pictures of the empty stage; what is there already is used."),
    ] = None,
) -> None:
    """Make and send the silhouettes of a take's cameras."""

    def work(stop: StopRequest) -> None:
        source = take_of_fit(open_source(take), fitted)
        own_keys = keys_of_client(keys, "segmentation")
        about(take=source.settings.name)
        chosen = _choose(source, cameras)
        if isinstance(source, LiveTake):
            serve_live(source, chosen, connect, stop, own_keys, segmenter, record, fitted, stage)
            return
        sender = Sender(source, chosen, segmenter, connect, own_keys, fitted, kept)
        try:
            sender.run(stop)
        finally:
            sender.close()

    run_service("segmentation", work, metrics)


if __name__ == "__main__":
    typer.run(main)
