"""Routes the coordinator's incoming messages, and sends the outgoing ones."""

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

log = logging.getLogger(__name__)

_SEEN_FRAMES = 32
"""Frames whose silhouettes are kept for viewers; arriving frames are a few ahead of the solved one."""
_MOST_AT_ONCE = 64
"""Messages read from one socket before the others get their turn."""


_KEPT_POSES = 1000
"""Poses kept for viewers and unexpected recorders; those that expected recorders lack are kept longer."""


class LostFramesError(Exception):
    """An expected recorder lacks frames that are no longer kept; a restarted coordinator solves them
    again."""


@dataclass
class _Recorder:
    name: str
    recording: Recording | None = None
    """Its last report of what it has on disk; None before the first."""
    end_frame: int = 0
    """At the end it has confirmed all frames before this one."""


class Switchboard:
    """Owns the ports; every call returns quickly, except that `pump` may wait."""

    def __init__(self, endpoint: str, incoming: Incoming, admission: Admission | None = None) -> None:
        self._ports = Ports(endpoint, admission, is_live=incoming.is_live)
        self._incoming = incoming
        self.dispatcher = Dispatcher(self._ports.send, time.monotonic)
        self._blobs: dict[str, Blob] = {}
        self._recorders: dict[Identity, _Recorder] = {}
        self._run, self._expected = "", 0
        self._forgotten_end = self._forgotten_settled_end = self._recorded_end = 0
        self._take_info: TakeInfo | None = None
        self._poses: dict[int, Pose] = {}
        self._settled: dict[int, Pose] = {}
        self._returned: dict[int, Pose] = {}
        self._asked_back = range(0)
        self._seen: OrderedDict[int, dict[tuple[int, ...], Silhouettes]] = OrderedDict()
        self._end: TakeEnd | None = None
        self._credit: Credit | None = None
        self._repeated_s = 0.0
        self.telemetry: Callable[[], Telemetry] | None = None
        """Returns the state of the take, which is published periodically."""
        self._foreign = 0
        self.recorders_heard_s = 0.0
        """When a recorder last requested or confirmed frames, or the take ended."""

    @property
    def n_recorders(self) -> int:
        """Number of registered recorders that have reported what they hold."""
        return len(self._recordings())

    def _recordings(self) -> list[Recording]:
        return [known.recording for known in self._recorders.values() if known.recording is not None]

    def recording(self, take: str, plan: str) -> Recording | None:
        """What all recorders hold of an earlier run of a plan; None if one of them has nothing."""
        held = self._recordings()
        least = min(held, key=lambda recording: recording.end_frame, default=None)
        if least is None or not len(least.poses):
            return None
        same = all((one.take, one.plan, one.run) == (take, plan, least.run) for one in held)
        return least if same else None

    def begin(self, run: str, first_frame: int, recorders: int) -> None:
        """Start a run from a frame on, for at least this many recorders."""
        self._run, self._expected = run, recorders
        self._forgotten_end = self._recorded_end = first_frame

    @property
    def recorders(self) -> dict[str, int]:
        """Recorders by name, and the end of what each has on disk of this run."""
        known = {one.name: one.recording for one in self._recorders.values()}
        return {
            name: recording.end_frame if recording and recording.run == self._run else 0
            for name, recording in known.items()
        }

    @property
    def n_unrecorded(self) -> int:
        """Poses that are kept because a recorder does not have them on disk yet."""
        return sum(frame >= self._recorded_end for frame in self._poses)

    def counts(self) -> dict[str, int]:
        """Numbers of repeated tasks and dropped messages."""
        dispatcher = self.dispatcher
        return {
            "retries": dispatcher.retries,
            "results_dropped": dispatcher.dropped,
            "foreign": self._foreign,
            **self._ports.counts(),
        }

    def recorded_up_to(self, end_frame: int, recorders: int) -> bool:
        """Whether at least this many recorders, and all that are registered, have all frames before
        end_frame."""
        gone = [i for i in self._behind(end_frame) if not self._ports.send(i, Beat())]
        if gone:
            self.pump(0)  # the confirmation of a recorder that has left may still wait here
        for identity in set(gone) & self._behind(end_frame):
            log.warning("lost %s", self._recorders.pop(identity).name)
        done = [recorder for recorder in self._recorders.values() if recorder.end_frame >= end_frame]
        return len(done) >= recorders and len(done) == len(self._recorders)

    def _behind(self, end_frame: int) -> set[Identity]:
        """Recorders that have not confirmed all frames before end_frame."""
        return {i for i, recorder in self._recorders.items() if recorder.end_frame < end_frame}

    def offer(self, blob: Blob) -> None:
        """Store content for requests."""
        self._blobs[blob.hash] = blob

    def announce(self, info: TakeInfo) -> None:
        """Announce the take to present and later recorders."""
        self._take_info = info
        self._ports.publish(info)
        for identity in self._recorders:
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
        """Publish a solved frame, and keep it until all recorders have it on disk."""
        self._poses[pose.frame] = pose
        self._ports.publish(pose)
        while len(self._poses) > _KEPT_POSES:
            oldest = next(iter(self._poses))
            if self._expected and oldest >= self._recorded_end:
                break  # a recorder is to get it yet
            del self._poses[oldest]
            self._forgotten_end = oldest + 1

    def publish_settled(self, pose: Pose) -> None:
        """Publish a settled frame, and keep it until all recorders have it on disk."""
        self._settled[pose.frame] = pose
        self._ports.publish(pose)
        held = [one.settled_end if one.run == self._run else 0 for one in self._recordings()]
        while len(self._settled) > _KEPT_POSES and len(held) >= max(1, self._expected):
            oldest = next(iter(self._settled))
            if oldest >= min(held):
                break
            del self._settled[oldest]
            self._forgotten_settled_end = oldest + 1

    def ask_recorders(self, first_frame: int, end_frame: int) -> None:
        """Request the first poses of frames of this run from all recorders, see `take_returned`."""
        self._asked_back = range(first_frame, end_frame)
        for identity in self._recorders:
            request = PoseRequest(run=self._run, first_frame=first_frame, end_frame=end_frame)
            self._ports.send(identity, request)

    def take_returned(self) -> dict[int, Pose]:
        """The requested poses that have come since the last call, by frame."""
        returned, self._returned = self._returned, {}
        return returned

    def end(self, message: TakeEnd) -> None:
        """Announce that no pose will follow."""
        self._end, self.recorders_heard_s = message, time.monotonic()
        self._repeat()
        for identity in self._recorders:
            self._ports.send(identity, message)

    def _repeat(self) -> None:
        """Publish again what late subscribers have missed."""
        self._repeated_s = time.monotonic()
        for message in (self._credit, self._take_info, self._end):
            if message is not None:
                self._ports.publish(message)
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
            credit = self._credit
            if credit is not None and credit.next_frame <= message.frame < credit.end_frame:
                self.keep(message)
            self._incoming.add(message)
        elif isinstance(message, LiveSilhouettes):
            self._incoming.add(message)
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
            if self.dispatcher.heard(identity) or identity in self._recorders:
                self._ports.send(identity, Beat())
        elif isinstance(message, LimbResult | LimbRefusal):
            self.dispatcher.heard(identity)
            self.dispatcher.finished(identity, message)
        elif isinstance(message, BlobRequest | SilhouettesRequest):
            self._send_content(identity, message)
        elif isinstance(message, Recording | PoseRequest | Recorded):
            self._hear_recorder(identity, message)
        elif isinstance(message, Pose) and self._is_asked_for(identity, message):
            self._returned[message.frame] = message
        elif isinstance(message, LiveSources):
            answer = self._incoming.answer(message)
            if answer is not None:
                self._ports.send(identity, answer)
        else:
            self._ports.drop(message)

    def _is_asked_for(self, identity: Identity, pose: Pose) -> bool:
        is_first = pose.run == self._run and not pose.settled
        return is_first and identity in self._recorders and pose.frame in self._asked_back

    def _hear_recorder(self, identity: Identity, message: Recording | PoseRequest | Recorded) -> None:
        """Handle a message of a recorder, or a viewer's request for poses; for other runs only what is
        kept."""
        if identity in self._recorders:
            self.recorders_heard_s = time.monotonic()
        if isinstance(message, Recording):
            if identity in self._recorders:  # else a late message of a lost connection: hello comes first
                self._recorders[identity].recording = message
                ours = [one.end_frame if one.run == self._run else 0 for one in self._recordings()]
                if len(ours) >= max(1, self._expected):
                    self._recorded_end = max(self._recorded_end, min(ours))
        elif message.run != self._run:
            self._foreign += 1
        elif isinstance(message, PoseRequest):
            self._send_poses(identity, message)
        else:
            if identity not in self._recorders:  # it has reconnected and not registered yet
                self._add_recorder(identity, "a recorder")
            self._recorders[identity].end_frame = message.end_frame

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
        """Note a recorder, and forget those that are gone, so that they do not become more and more."""
        here = {i: known for i, known in self._recorders.items() if self._ports.send(i, Beat())}
        self._recorders = {**here, identity: _Recorder(name)}

    def _send_content(self, identity: Identity, request: BlobRequest | SilhouettesRequest) -> None:
        if isinstance(request, SilhouettesRequest):
            for seen in self._seen.get(request.frame, {}).values():
                self._ports.send(identity, seen)
        elif request.hash in self._blobs:
            self._ports.send(identity, self._blobs[request.hash])
        else:
            log.warning("a client asked for unknown content %s", request.hash[:8])

    def _send_poses(self, identity: Identity, request: PoseRequest) -> None:
        kept, forgotten_end = self._poses, self._forgotten_end
        if request.settled:
            kept, forgotten_end = self._settled, self._forgotten_settled_end
        if request.first_frame < forgotten_end:
            name = self._recorders[identity].name if identity in self._recorders else "a recorder"
            problem = f"{name} lacks frame {request.first_frame}, which is no longer kept"
            if self._expected and identity in self._recorders:  # a viewer may miss some
                raise LostFramesError(f"{problem}: a restarted coordinator solves it again")
            log.info("%s", problem)
        for frame in range(request.first_frame, min(request.end_frame, request.first_frame + _MOST_AT_ONCE)):
            if frame in kept and not self._ports.send(identity, kept[frame]):
                break  # its queue is full; it asks again

    def close(self) -> None:
        """Close the sockets, letting what was sent go out."""
        self._ports.close()
