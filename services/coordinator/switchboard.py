"""What comes in at the coordinator's ports brought to whom it concerns, and what goes out."""

import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from proto.auth import Admission
from proto.messages import (
    Beat,
    Blob,
    BlobRequest,
    Credit,
    Hello,
    LimbRefusal,
    LimbResult,
    Message,
    Pose,
    PoseRequest,
    Recorded,
    Silhouettes,
    SilhouettesRequest,
    TakeEnd,
    TakeInfo,
)
from proto.streams import StreamName
from services.coordinator.dispatch import Dispatcher, Identity
from services.coordinator.ports import Ports

log = logging.getLogger(__name__)

_PUBLISH_S = 0.5
"""How often the state of the take is published again, for those who joined late."""
_SEEN_FRAMES = 32
"""Frames whose silhouettes are kept for viewers; what arrives is a few frames ahead of what is solved."""
_MOST_AT_ONCE = 64
"""Messages taken from one socket before the others get their turn."""


@dataclass
class _Recorder:
    name: str
    end_frame: int = 0
    """It has all frames before this one."""


class Switchboard:
    """Owns the ports; every call returns quickly except for the wait that `pump` is told."""

    def __init__(
        self,
        endpoint: str,
        on_silhouettes: Callable[[Silhouettes], None],
        admission: Admission | None = None,
    ) -> None:
        self._ports = Ports(endpoint, admission)
        self._on_silhouettes = on_silhouettes
        self.dispatcher = Dispatcher(self._ports.send, time.monotonic)
        self._blobs: dict[str, Blob] = {}
        self._recorders: dict[Identity, _Recorder] = {}
        self._take_info: TakeInfo | None = None
        self._poses: dict[int, Pose] = {}
        self._seen: OrderedDict[int, dict[tuple[int, ...], Silhouettes]] = OrderedDict()
        self._end: TakeEnd | None = None
        self._credit: Credit | None = None
        self._credit_sent_s = 0.0
        self.recorders_heard_s = 0.0
        """When a recorder last asked for or confirmed something, or the take ended."""

    @property
    def n_recorders(self) -> int:
        """Recorders that are registered."""
        return len(self._recorders)

    def counts(self) -> dict[str, int]:
        """What was given out again, and what was dropped."""
        dispatcher = self.dispatcher
        return {
            "retries": dispatcher.retries,
            "results_dropped": dispatcher.dropped,
            **self._ports.counts(),
        }

    def recorded_up_to(self, end_frame: int, recorders: int) -> bool:
        """Whether so many recorders have all frames before end_frame, and no other lacks any."""
        behind = [i for i, recorder in self._recorders.items() if recorder.end_frame < end_frame]
        for identity in behind:
            if not self._ports.send(identity, Beat()):
                log.warning("lost %s", self._recorders.pop(identity).name)
        done = [recorder for recorder in self._recorders.values() if recorder.end_frame >= end_frame]
        return len(done) >= recorders and len(done) == len(self._recorders)

    def offer(self, blob: Blob) -> None:
        """Keep content for those who ask for it."""
        self._blobs[blob.hash] = blob

    def announce(self, info: TakeInfo) -> None:
        """Tell recorders, present and to come, about the take."""
        self._take_info = info
        self._ports.publish(info)
        for identity in self._recorders:
            self._tell_take(identity)

    def _tell_take(self, identity: Identity) -> None:
        """Send a recorder what it needs to write results, lest it has to ask a coordinator that is gone."""
        if self._take_info is not None:
            self._ports.send(identity, self._take_info)
            for content in (self._take_info.actor, self._take_info.rig):
                self._ports.send(identity, self._blobs[content])

    def give_credit(self, credit: Credit) -> None:
        """Let segmentation go on."""
        self._credit = credit
        self._publish_credit()

    def publish(self, pose: Pose) -> None:
        """Send a solved frame to all who listen, and keep it for recorders that missed it."""
        self._poses[pose.frame] = pose
        self._ports.publish(pose)

    def end(self, message: TakeEnd) -> None:
        """Say that no pose will follow."""
        self._end, self.recorders_heard_s = message, time.monotonic()
        self._ports.publish(message)
        for identity in self._recorders:
            self._ports.send(identity, message)

    def _publish_credit(self) -> None:
        self._credit_sent_s = time.monotonic()
        if self._credit is not None:
            self._ports.publish(self._credit)

    def _repeat(self) -> None:
        """Publish once more what those who joined late have missed."""
        self._publish_credit()
        for message in (self._take_info, self._end):
            if message is not None:
                self._ports.publish(message)

    def pump(self, timeout_s: float) -> None:
        """Wait up to timeout_s for a message, then act on all that have come."""
        if time.monotonic() - self._credit_sent_s > _PUBLISH_S:
            self._repeat()
        self._ports.wait(timeout_s)
        for _ in range(_MOST_AT_ONCE):
            if not self._take_one("silhouettes") and not self._take_one("tasks"):
                break

    def _take_one(self, stream: StreamName) -> bool:
        """Act on one waiting message of a stream; False if there was none."""
        arrived = self._ports.receive(stream)
        if arrived is None:
            return False
        identity, message = arrived
        if stream == "tasks":
            self._act(identity, message)
        elif isinstance(message, Silhouettes):
            self._keep_for_viewers(message)
            self._on_silhouettes(message)
        else:
            self._ports.drop(message)
        return True

    def _keep_for_viewers(self, message: Silhouettes) -> None:
        """Keep silhouettes of the last frames that were asked for."""
        credit = self._credit
        if credit is None or not credit.next_frame <= message.frame < credit.end_frame:
            return
        self._seen.setdefault(message.frame, {})[tuple(message.cameras)] = message
        while len(self._seen) > _SEEN_FRAMES:
            self._seen.popitem(last=False)

    def _act(self, identity: Identity, message: Message) -> None:
        if isinstance(message, Hello):
            self._welcome(identity, message)
        elif isinstance(message, Beat):
            if self.dispatcher.heard(identity) or identity in self._recorders:
                self._ports.send(identity, Beat())
        elif isinstance(message, LimbResult | LimbRefusal):
            self.dispatcher.heard(identity)
            self.dispatcher.finished(identity, message)
        elif isinstance(message, BlobRequest | SilhouettesRequest):
            self._send_content(identity, message)
        elif isinstance(message, PoseRequest):
            self.recorders_heard_s = time.monotonic()
            self._send_poses(identity, message)
        elif isinstance(message, Recorded):
            self.recorders_heard_s = time.monotonic()
            if identity not in self._recorders:  # its connection was made anew, and it has not registered yet
                self._add_recorder(identity, "a recorder")
            self._recorders[identity].end_frame = message.end_frame
        else:
            self._ports.drop(message)

    def _welcome(self, identity: Identity, hello: Hello) -> None:
        log.info("%s says hello", hello.name)
        self._ports.send(identity, Beat())
        if hello.role == "limb_worker":
            self.dispatcher.heard(identity, hello)
            return
        self._recorders = {i: known for i, known in self._recorders.items() if known.name != hello.name}
        self._add_recorder(identity, hello.name)
        self._tell_take(identity)
        if self._end is not None:
            self._ports.send(identity, self._end)

    def _add_recorder(self, identity: Identity, name: str) -> None:
        """Note a recorder, and forget those that are gone, lest there be ever more."""
        here = {i: known for i, known in self._recorders.items() if self._ports.send(i, Beat())}
        self._recorders = here | {identity: _Recorder(name)}

    def _send_content(self, identity: Identity, request: BlobRequest | SilhouettesRequest) -> None:
        if isinstance(request, SilhouettesRequest):
            for seen in self._seen.get(request.frame, {}).values():
                self._ports.send(identity, seen)
        elif request.hash in self._blobs:
            self._ports.send(identity, self._blobs[request.hash])
        else:
            log.warning("unknown content %s was asked for", request.hash[:8])

    def _send_poses(self, identity: Identity, request: PoseRequest) -> None:
        for frame in range(request.first_frame, min(request.end_frame, request.first_frame + _MOST_AT_ONCE)):
            if frame in self._poses and not self._ports.send(identity, self._poses[frame]):
                break  # its queue is full; it asks again

    def close(self) -> None:
        """Close the sockets, letting what was sent go out."""
        self._ports.close()
