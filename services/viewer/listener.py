"""Follows a coordinator: its poses, what they mean, and what was missed; it costs that next to nothing."""

import logging
import queue
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import zmq

from proto.framing import MalformedMessage
from proto.keys import ClientKeys
from proto.link import Line
from proto.messages import (
    Blob,
    BlobRequest,
    Message,
    Pose,
    PoseRequest,
    Silhouettes,
    SilhouettesRequest,
    TakeEnd,
    TakeInfo,
)
from proto.sockets import receive, send, wait
from services.mocap.body.actor import build_body
from services.mocap.take.folder import Take
from services.mocap.take.marks import PARTS
from services.viewer.contents import Contents
from services.viewer.finished import FinishedTake
from services.viewer.pictures import TakePictures
from services.viewer.reel import RING_FRAMES, STAGES, Reel, Shot
from services.viewer.seen import LivePictures
from services.viewer.show import Show
from services.viewer.tiles import TileArtist

_ASK_AGAIN_S = 0.5
_CHUNK_FRAMES = 64
"""Poses that the coordinator sends at one request, at most."""
_MOST_AT_ONCE = 500
"""Messages that are taken in before requests get their turn."""

log = logging.getLogger(__name__)


class Listener:
    """Makes a show of whatever the coordinator tracks, take after take."""

    def __init__(
        self,
        endpoint: str,
        keys: ClientKeys | None,
        folder: Take | None,
        present: Callable[[Show], None],
        results: Path | None = None,
    ) -> None:
        """folder: the take's, for its pictures, where this host has it. present is called with each show.

        results: where the results will be, from which frames come that nobody else has any more.
        """
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._poses = Line(self._context, endpoint, "poses", keys)
        self._tasks = Line(self._context, endpoint, "tasks", keys)
        self._folder, self._present, self._results = folder, present, results
        self._requests: queue.SimpleQueue[Message] = queue.SimpleQueue()
        """From the pages' threads; sockets belong to the listener's."""
        self._asked_s = 0.0
        self._info: TakeInfo | None = None
        self._contents: Contents | None = None
        self._reel: Reel | None = None
        self._pictures: LivePictures | None = None

    def listen(self, timeout_s: float) -> None:
        """Wait a moment for messages, take them in, and ask for what is missing."""
        wait([self._poses.socket, self._tasks.socket], timeout_s)
        for line in (self._poses, self._tasks):
            for _ in range(_MOST_AT_ONCE):
                try:
                    message = receive(line.socket)
                except MalformedMessage as error:
                    log.warning("dropped a malformed message: %s", error)
                    continue
                if message is None:
                    break
                self._take_in(message)
            line.tick()
        self._ask()

    def _take_in(self, message: Message) -> None:
        if isinstance(message, TakeInfo):
            self._begin(message)
        elif isinstance(message, Blob) and self._contents is not None:
            self._contents.add(message)
            self._raise_curtain()
        elif self._reel is None or self._info is None or getattr(message, "take", None) != self._info.take:
            return
        elif isinstance(message, Pose):
            self._reel.put(_shot(message))
        elif isinstance(message, Silhouettes) and self._pictures is not None:
            self._pictures.add(message)
        elif isinstance(message, TakeEnd):
            self._reel.is_over = True

    def _begin(self, info: TakeInfo) -> None:
        """Begin anew where another take, or the same one anew, is tracked."""
        if info == self._info:
            return
        log.info("take %s, frames %d to %d", info.take, info.first_frame, info.end_frame - 1)
        self._info, self._contents, self._pictures = info, Contents(info), None
        finished = FinishedTake(self._results, info.take)
        frames = range(info.first_frame, info.end_frame)
        self._reel = Reel(frames, RING_FRAMES, lambda frame: self._older(frame, finished))
        self._asked_s = 0.0

    def _older(self, frame: int, finished: FinishedTake) -> Shot | None:
        """A frame that has left the ring: from the results, or asked for, with those about it."""
        if self._reel is not None and self._reel.is_over and (shot := finished.shot(frame)) is not None:
            return shot
        first = max(0, frame - _CHUNK_FRAMES // 4)
        if self._info is not None:
            end = first + _CHUNK_FRAMES
            self._requests.put(PoseRequest(run=self._info.run, first_frame=first, end_frame=end))
        return None

    def _raise_curtain(self) -> None:
        """Present the take once all that drawing needs is there."""
        if self._info is None or self._contents is None or self._reel is None or self._pictures is not None:
            return
        read = None if self._contents.missing() else self._contents.read()
        if read is None:
            return
        info, rig, body = self._info, read[1], build_body(read[0])
        folder = self._folder if self._folder is not None and self._fits(self._folder, info) else None
        pictures = None if folder is None else TakePictures(folder, None)
        self._pictures = LivePictures(
            rig, pictures, lambda f: self._requests.put(SilhouettesRequest(frame=f))
        )
        if folder is None:
            names = tuple(f"camera {c + 1}" for c in range(rig.n_cameras))
        else:
            names = tuple(camera.name for camera in folder.cameras)
        artist = TileArtist(body, rig, self._pictures)
        self._present(Show(info.take, info.fps, self._reel, body, rig, names, artist, is_live=True))

    def _fits(self, folder: Take, info: TakeInfo) -> bool:
        """Whether a folder is that of the take that is tracked."""
        fits = folder.settings.name == info.take and folder.settings.frames >= info.end_frame
        if not fits:
            log.warning("%s is another take than %s: there are silhouettes only", folder.folder, info.take)
        return fits

    def _ask(self) -> None:
        while not self._requests.empty():
            send(self._tasks.socket, self._requests.get())
        if time.monotonic() - self._asked_s < _ASK_AGAIN_S:
            return
        self._asked_s = time.monotonic()
        for content in self._contents.missing() if self._contents is not None else []:
            send(self._tasks.socket, BlobRequest(hash=content))
        gap = None if self._reel is None else self._reel.first_gap()
        if gap is not None and self._info is not None:
            wanted = PoseRequest(run=self._info.run, first_frame=gap.start, end_frame=gap.stop)
            send(self._tasks.socket, wanted)

    def close(self) -> None:
        """Close the sockets."""
        self._tasks.close()
        self._poses.close()
        self._context.term()


def _shot(message: Pose) -> Shot:
    return Shot(
        frame=message.frame,
        time_s=message.time_s,
        pose=message.pose,
        energy_px=message.energy_px,
        confidence=np.array([message.confidence.get(part, np.nan) for part in PARTS]),
        distrusted=np.array([part in message.distrusted for part in PARTS]),
        part_px=np.array([message.part_px.get(part, np.nan) for part in PARTS]),
        seconds=np.array([message.seconds.get(stage, np.nan) for stage in STAGES]),
        arrived_s=time.monotonic(),
    )
