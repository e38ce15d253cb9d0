"""Routes the coordinator's incoming messages, and sends the outgoing ones."""

import logging
import time
from collections import OrderedDict
from collections.abc import Callable

from proto.auth import Admission
from proto.messages import (
    Beat,
    Blob,
    BlobRequest,
    Credit,
    Hello,
    LimbRefusal,
    LimbResult,
    LiveSilhouettes,
    LiveSources,
    Message,
    Pose,
    PoseRequest,
    Recorded,
    Recording,
    Silhouettes,
    SilhouettesRequest,
    TakeEnd,
    TakeInfo,
    Telemetry,
)
from proto.streams import PUBLISHED, StreamName
from services.coordinator.dispatch import Dispatcher, Identity
from services.coordinator.incoming import Incoming
from services.coordinator.ports import Ports
from services.coordinator.recorders import Recorders

log = logging.getLogger(__name__)

_SEEN_FRAMES = 32
"""Frames whose silhouettes are kept for viewers; arriving frames are a few ahead of the solved one."""
_MOST_AT_ONCE = 64
"""Messages read from one socket before the others get their turn."""


class Switchboard:
    """Owns the ports; every call returns quickly, except that `pump` may wait."""

    def __init__(self, endpoint: str, incoming: Incoming, admission: Admission | None = None) -> None:
        self._ports = Ports(endpoint, admission, is_live=incoming.is_live)
        self.incoming = incoming
        self.dispatcher = Dispatcher(self._ports.send, time.monotonic)
        self._blobs: dict[str, Blob] = {}
        self.recorders = Recorders(self._ports.send)
        self._take_info: TakeInfo | None = None
        self._seen: OrderedDict[int, dict[tuple[int, ...], Silhouettes]] = OrderedDict()
        self._end: TakeEnd | None = None
        self._credit: Credit | None = None
        self._repeated_s = 0.0
        self.telemetry: Callable[[], Telemetry] | None = None
        """Returns the state of the take, which is published periodically."""

    def counts(self) -> dict[str, int]:
        """Numbers of repeated tasks and dropped messages."""
        dispatcher = self.dispatcher
        return {
            "retries": dispatcher.retries,
            "results_dropped": dispatcher.dropped,
            "foreign": self.recorders.foreign,
            **self._ports.counts(),
            "silhouettes_dropped": self.incoming.dropped,
        }

    def offer(self, blob: Blob) -> None:
        """Store content for requests."""
        self._blobs[blob.hash] = blob

    def announce(self, info: TakeInfo) -> None:
        """Announce the take to present and later recorders."""
        self._take_info = info
        self._ports.publish(info)
        for identity in self.recorders:
            self._tell_take(identity)

    def _tell_take(self, identity: Identity) -> None:
        """Send a recorder everything that results need, because it cannot ask after the coordinator has
        exited."""
        if self._take_info is not None:
            self._ports.send(identity, self._take_info)
            for content in (self._take_info.actor, self._take_info.rig):
                self._ports.send(identity, self._blobs[content])

    def give_credit(self, credit: Credit) -> None:
        """Let segmentation continue."""
        self._credit = credit
        self._ports.publish(credit)

    def publish(self, pose: Pose) -> None:
        """Publish a solved or settled frame, and keep it until all recorders have it on disk."""
        self._ports.publish(pose)
        self.recorders.keep(pose)

    def end(self, message: TakeEnd) -> None:
        """Tell recorders that no pose will follow, and everybody if the input is live: cameras do not wait,
        and their silhouettes cannot be sent again."""
        self._end, self.recorders.heard_s = message, time.monotonic()
        self._repeat()

    def publish_end(self) -> None:
        """Tell everybody. Segmentation leaves then, so recorders must have all frames: else a restarted
        coordinator would wait for silhouettes in vain."""
        if self._end is not None:
            self._ports.publish(self._end)

    def _repeat(self) -> None:
        """Send again what late subscribers have missed, and what may not have reached recorders."""
        self._repeated_s = time.monotonic()
        for message in (self._credit, self._take_info):
            if message is not None:
                self._ports.publish(message)
        if self._end is not None:
            for identity in self.recorders:
                self._ports.send(identity, self._end)
            if self.incoming.is_live:
                self.publish_end()
        if self.telemetry is not None:
            self._ports.publish(self.telemetry())

    def pump(self, timeout_s: float) -> None:
        """Wait up to timeout_s for a message, then handle all that have arrived."""
        if time.monotonic() - self._repeated_s > PUBLISHED.every_s:
            self._repeat()
        ready = self._ports.wait(timeout_s)
        for _ in range(_MOST_AT_ONCE):
            if not ready:
                break
            ready = [stream for stream in ready if self._take_one(stream)]

    def _take_one(self, stream: StreamName) -> bool:
        """Handle one waiting message of a stream; False if there was none."""
        arrived = self._ports.receive(stream)
        if arrived is None:
            return False
        identity, message = arrived
        if stream == "tasks":
            self._act(identity, message)
        elif isinstance(message, Silhouettes):
            if self.incoming.add(message):
                self.keep(message)
        elif isinstance(message, LiveSilhouettes):
            self.incoming.add(message)
        else:
            self._ports.drop(message)
        return True

    def keep(self, message: Silhouettes) -> None:
        """Keep silhouettes for viewers: those of the last frames."""
        self._seen.setdefault(message.frame, {})[tuple(message.cameras)] = message
        while len(self._seen) > _SEEN_FRAMES:
            self._seen.popitem(last=False)

    def _act(self, identity: Identity, message: Message) -> None:
        if isinstance(message, Hello):
            self._welcome(identity, message)
        elif isinstance(message, Beat):
            if self.dispatcher.heard(identity) or identity in self.recorders:
                self._ports.send(identity, Beat())
        elif isinstance(message, LimbResult | LimbRefusal):
            self.dispatcher.finished(identity, message)  # first: heard may take a slow worker's task away
            self.dispatcher.heard(identity)
        elif isinstance(message, BlobRequest | SilhouettesRequest):
            self._send_content(identity, message)
        elif isinstance(message, Recording | PoseRequest | Recorded):
            self.recorders.hear(identity, message)
        elif isinstance(message, LiveSources):
            answer = self.incoming.answer(message)
            if answer is not None:
                self._ports.send(identity, answer)
        elif not isinstance(message, Pose) or not self.recorders.take_back(identity, message):
            self._ports.drop(message)

    def _welcome(self, identity: Identity, hello: Hello) -> None:
        log.info("%s says hello", hello.name)
        self._ports.send(identity, Beat())
        if hello.role == "limb_worker":
            self.dispatcher.heard(identity, hello)
            return
        self.recorders.register(identity, hello.name)
        self._tell_take(identity)
        if self._end is not None:
            self._ports.send(identity, self._end)

    def _send_content(self, identity: Identity, request: BlobRequest | SilhouettesRequest) -> None:
        if isinstance(request, SilhouettesRequest):
            for seen in self._seen.get(request.frame, {}).values():
                self._ports.send(identity, seen)
        elif request.hash in self._blobs:
            self._ports.send(identity, self._blobs[request.hash])
        else:
            log.warning("a client asked for unknown content %s", request.hash[:8])

    def close(self) -> None:
        """Close the sockets, letting what was sent go out."""
        self._ports.close()
