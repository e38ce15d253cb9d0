"""What services share that follow a coordinator without taking part: its takes, its poses, what they mean."""

import logging
import queue
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence

import zmq

from proto.framing import MalformedMessage
from proto.keys import ClientKeys
from proto.link import Line
from proto.messages import Blob, BlobRequest, Message, TakeInfo
from proto.sockets import receive, send, wait
from services.blob_store import BlobStore
from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig
from services.pose_size import with_whole_poses

_ASK_AGAIN_S = 0.5
_MOST_AT_ONCE = 500
"""Messages that are taken in before requests get their turn."""

log = logging.getLogger(__name__)


class Follower(ABC):
    """Hears what a coordinator tracks, take after take; it registers nowhere, so that nobody waits for it."""

    def __init__(self, endpoint: str, keys: ClientKeys | None) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._poses = Line(self._context, endpoint, "poses", keys)
        self._tasks = Line(self._context, endpoint, "tasks", keys)
        self._requests: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._asked_s = 0.0
        self.info: TakeInfo | None = None
        """The take that is tracked."""
        self.heard_s = 0.0
        """When a message came last (time.monotonic)."""
        self._blobs: BlobStore | None = None
        """Its content, as long as some of it is missing."""

    @abstractmethod
    def begin(self, info: TakeInfo) -> None:
        """Another take is tracked, or the same one anew."""

    @abstractmethod
    def learn(self, actor: Actor, rig: Rig) -> None:
        """All that the take's poses need to be understood is here."""

    @abstractmethod
    def hear(self, message: Message) -> None:
        """A message of the take has come, before or after what it needs to be understood."""

    def lacking(self) -> Sequence[Message]:
        """What to ask for that did not come; looked at about twice a second."""
        return ()

    def ask(self, request: Message) -> None:
        """Ask the coordinator, at the end of this look or of the next; from any thread."""
        self._requests.put(request)

    def listen(self, timeout_s: float) -> None:
        """Wait a moment for messages, take them in, and ask for what is missing."""
        wait([self._poses.socket, self._tasks.socket], timeout_s)
        for line in (self._poses, self._tasks):
            for _ in range(_MOST_AT_ONCE):
                try:
                    message = with_whole_poses(receive(line.socket))
                except MalformedMessage as error:
                    log.warning("dropped a malformed message: %s", error)
                    continue
                if message is None:
                    break
                self._take_in(message)
            line.tick()
        self._ask()

    def _take_in(self, message: Message) -> None:
        self.heard_s = time.monotonic()
        if isinstance(message, TakeInfo):
            if message != self.info:
                log.info("take %s, frames %d to %d", message.take, message.first_frame, message.end_frame - 1)
                self.info, self._blobs, self._asked_s = message, BlobStore(message), 0.0
                self.begin(message)
        elif isinstance(message, Blob):
            self._add(message)
        elif self.info is not None and getattr(message, "take", None) == self.info.take:
            self.hear(message)

    def _add(self, blob: Blob) -> None:
        if self._blobs is None:
            return
        self._blobs.add(blob)
        read = None if self._blobs.missing() else self._blobs.read()
        if read is not None:
            self._blobs = None
            self.learn(*read)

    def _ask(self) -> None:
        while not self._requests.empty():
            send(self._tasks.socket, self._requests.get())
        if time.monotonic() - self._asked_s < _ASK_AGAIN_S:
            return
        self._asked_s = time.monotonic()
        for content in self._blobs.missing() if self._blobs is not None else []:
            send(self._tasks.socket, BlobRequest(hash=content))
        for request in self.lacking():
            send(self._tasks.socket, request)

    def close(self) -> None:
        """Close the sockets."""
        self._tasks.close()
        self._poses.close()
        self._context.term()
