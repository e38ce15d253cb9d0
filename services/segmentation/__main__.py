"""Segmentation process: `python -m services.segmentation --take TAKE --connect tcp://HOST:5550`."""

import logging
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
import zmq

from proto.framing import MalformedMessage
from proto.keys import ClientKeys
from proto.link import Line
from proto.messages import Credit, Silhouettes, TakeEnd
from proto.sockets import receive, send, wait
from proto.streams import DEFAULT_ENDPOINT
from services.health import beat
from services.logs import about
from services.metrics import DROPPED
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.errors import UserError, nearest
from services.mocap.take.folder import Take
from services.mocap.take.live import LiveTake, open_source
from services.options import DEFAULT_SEGMENTER, KeysOption, MetricsOption, SegmenterOption, keys_of_client
from services.process import StopRequest, run_service
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.live.serving import serve_live
from services.segmentation.metrics import CREDIT, FRAMES, SECONDS
from services.segmentation.segmenters import PlateCheck, make_segmenter
from services.segmentation.source import packed

_LOOK_S = 0.2
_RESEND_S = 3.0
"""A frame that was sent and is still asked for after so long got lost with a coordinator."""

log = logging.getLogger(__name__)


class Feed:
    """The packed silhouettes of a group of cameras, from any frame on."""

    def __init__(
        self, take: Take, cameras: list[int], settings: SegmentationSettings, segmenter: str
    ) -> None:
        self._height, self._width = Rig.of(take.cameras).shape_px
        self._checks: deque[PlateCheck] = deque()
        chosen = [take.cameras[c] for c in cameras]
        self._segmenter = make_segmenter(take, chosen, settings, segmenter, self._checks.append)
        self._end = take.settings.frames

    def check_a_plate(self) -> bool:
        """Warn of a camera's clean plate if it is not clean; False once all have been looked at."""
        if self._checks:
            self._checks.popleft()()
        return bool(self._checks)

    def planes(self, start: int) -> Iterator[TriPlanes]:
        """Planes (P, H, W) of frames start to the take's end."""
        for trimaps in self._segmenter.trimaps(start, self._end):
            yield packed(trimaps, self._width, self._height)


class Sender:
    """Sends frames as far as the coordinator's credit goes."""

    def __init__(self, take: Take, cameras: list[int], feed: Feed, line: Line) -> None:
        self._take, self._cameras, self._feed, self._line = take, cameras, feed, line
        self._run, self._next = "", 0
        self._planes: Iterator[TriPlanes] | None = None
        self._unsent: Silhouettes | None = None
        self._advanced_s = time.monotonic()

    @property
    def next_frame(self) -> int:
        """The frame that is sent next."""
        return self._next

    def begin_anew(self) -> None:
        """Go to where the next credit says: what was sent to another connection may be lost with it."""
        self._planes = None

    def follow(self, credit: Credit) -> None:
        """Go to where the coordinator is, should it be behind (it restarted), far ahead, or another run's."""
        stalled = credit.next_frame < self._next and time.monotonic() - self._advanced_s > _RESEND_S
        is_other = credit.run != self._run
        if self._planes is None or stalled or is_other or credit.next_frame > self._next:
            self._run, self._next, self._unsent = credit.run, credit.next_frame, None
            self._planes = self._feed.planes(self._next)
            self._advanced_s = time.monotonic()

    def send_next(self, credit: Credit) -> bool:
        """Send one frame if credit allows; False when there is nothing to do just now."""
        if self._unsent is None:
            if self._planes is None or self._next >= credit.end_frame:
                return False
            about(frame=self._next)
            with SECONDS.time():
                planes = next(self._planes)
            self._unsent = Silhouettes(
                take=self._take.settings.name,
                run=self._run,
                frame=self._next,
                cameras=self._cameras,
                planes=planes.silhouettes,
                unsure=planes.sent_unsure,
            )
        if not send(self._line.socket, self._unsent):
            return False
        FRAMES.inc()
        self._next, self._unsent = self._next + 1, None
        self._advanced_s = time.monotonic()
        return True


def serve(
    take_folder: Path,
    cameras: str,
    endpoint: str,
    stop: StopRequest,
    keys: ClientKeys | None = None,
    segmenter: str = DEFAULT_SEGMENTER,
    record: Path | None = None,
) -> None:
    """Send silhouettes until the take ends or a stop is asked for. record: where live pictures are kept."""
    take = open_source(take_folder)
    about(take=take.settings.name)
    chosen = _choose(take, cameras)
    if isinstance(take, LiveTake):
        serve_live(take, chosen, endpoint, stop, keys, segmenter, record)
        return
    feed = Feed(take, chosen, SegmentationSettings(), segmenter)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    silhouettes = Line(context, endpoint, "silhouettes", keys)
    poses = Line(context, endpoint, "poses", keys)
    sender = Sender(take, chosen, feed, silhouettes)
    log.info("ready: %s from %s", ", ".join(take.cameras[c].name for c in chosen), take.source)
    try:
        _send_all(take, feed, sender, silhouettes, poses, stop)
        while not stop and feed.check_a_plate():
            beat()  # of a take that was over before all had been looked at
    finally:
        silhouettes.close()
        poses.close()
        context.term()


def _send_all(
    take: Take, feed: Feed, sender: Sender, silhouettes: Line, poses: Line, stop: StopRequest
) -> None:
    """Follow the coordinator's credit until it says that the take is over; between frames look at plates."""
    credit: Credit | None = None
    while not stop:
        beat()
        try:
            while (message := receive(poses.socket)) is not None:
                if isinstance(message, TakeEnd) and message.take == take.settings.name:
                    return
                if isinstance(message, Credit) and message.take == take.settings.name:
                    credit = message
                    CREDIT.set(max(credit.end_frame - sender.next_frame, 0))
                    sender.follow(credit)
        except MalformedMessage as error:
            DROPPED.inc()
            log.warning("dropped a malformed message: %s", error)
        if credit is None or not sender.send_next(credit):
            wait([poses.socket], 0.0 if feed.check_a_plate() else _LOOK_S)
        is_cut = [silhouettes.tick(), poses.tick()]
        if any(is_cut):
            sender.begin_anew()


def _choose(take: Take, names: str) -> list[int]:
    """Camera indices from names with commas between; none given: all."""
    known = [camera.name for camera in take.cameras]
    wanted = [name.strip() for name in names.split(",") if name.strip()] or known
    for name in wanted:
        if name not in known:
            raise UserError(f"--cameras {name}: {take.folder} has no such camera: {nearest(name, known)}")
    return [known.index(name) for name in wanted]


def main(
    take: Annotated[Path, typer.Option(help="The take folder, or a live configuration.")],
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    cameras: Annotated[str, typer.Option(help="Cameras to serve, with commas between; all by default.")] = "",
    keys: KeysOption = None,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    metrics: MetricsOption = None,
    record: Annotated[Path | None, typer.Option(help="Live: the folder that pictures are kept in.")] = None,
) -> None:
    """Make and send the silhouettes of a take's cameras."""

    def work(stop: StopRequest) -> None:
        serve(take, cameras, connect, stop, keys_of_client(keys, "segmentation"), segmenter, record)

    run_service("segmentation", work, metrics)


if __name__ == "__main__":
    typer.run(main)
