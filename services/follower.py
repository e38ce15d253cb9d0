"""What clients share that follow a coordinator without taking part: its takes, its poses, what they mean."""

import logging
import queue
import time
from abc import abstractmethod
from collections.abc import Sequence

from proto.keys import ClientKeys
from proto.link import Line
from proto.messages import Blob, BlobRequest, Message, TakeInfo
from proto.streams import ASK_AGAIN_S
from services.blob_store import BlobStore, DamagedBlobError, UnusableBlobError
from services.listener import PosesListener
from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig
from services.pose_size import with_whole_poses

log = logging.getLogger(__name__)


class Follower(PosesListener):
    """Follows what a coordinator tracks, take after take, and asks it for what the poses mean."""

    def __init__(self, endpoint: str, keys: ClientKeys | None) -> None:
        super().__init__(endpoint, keys)
        self._tasks = Line(self.context, endpoint, "tasks", keys)
        self.lines.append(self._tasks)
        self._requests: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._asked_s = 0.0
        self.info: TakeInfo | None = None
        """The current take."""
        self._blobs: BlobStore | None = None
        """The take's content, while some of it is missing."""

    @abstractmethod
    def on_take(self, info: TakeInfo) -> None:
        """Called when a take begins, or begins again."""

    @abstractmethod
    def on_content(self, actor: Actor, rig: Rig) -> None:
        """Called when the actor and the rig of the take have arrived."""

    @abstractmethod
    def on_message(self, message: Message) -> None:
        """Called for each message of the take, before or after its actor and rig arrived."""

    def lacking(self) -> Sequence[Message]:
        """Requests for messages that did not arrive; called about twice a second."""
        return ()

    def ask(self, request: Message) -> None:
        """Send a request to the coordinator at the end of this or the next `listen`; from any thread."""
        self._requests.put(request)

    def listen(self, timeout_s: float) -> None:
        """Wait briefly for messages, handle them, and request what is missing."""
        super().listen(timeout_s)
        while not self._requests.empty():
            self._tasks.send(self._requests.get())
        if time.monotonic() - self._asked_s < ASK_AGAIN_S:
            return
        self._asked_s = time.monotonic()
        for content in self._blobs.missing(self.info) if self._blobs and self.info else []:
            self._tasks.send(BlobRequest(hash=content))
        for request in self.lacking():
            self._tasks.send(request)

    def take_in(self, message: Message) -> None:
        """Tell takes from what belongs to them."""
        message = with_whole_poses(message)
        if isinstance(message, TakeInfo):
            if message != self.info:
                log.info("take %s, frames %d to %d", message.take, message.first_frame, message.end_frame - 1)
                self.info, self._blobs, self._asked_s = message, BlobStore(), 0.0
                self.on_take(message)
        elif isinstance(message, Blob):
            self._add(message)
        elif self.info is not None and getattr(message, "take", None) == self.info.take:
            self.on_message(message)

    def _add(self, blob: Blob) -> None:
        if self._blobs is None or self.info is None or blob.hash not in self._blobs.missing(self.info):
            return
        try:
            self._blobs.add(blob)
            if self._blobs.missing(self.info):
                return
            actor, rig = self._blobs.actor(self.info), self._blobs.rig(self.info)
        except DamagedBlobError as error:  # it is asked for again
            log.warning("damaged content: %s", error)
        except (UnusableBlobError, ValueError) as error:
            log.warning("the take cannot be shown: %s", error)
            self._blobs = None
        else:
            self._blobs = None
            self.on_content(actor, rig)
