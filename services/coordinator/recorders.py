"""The recorders of a take: what each has on disk, and the poses that are kept for those that lack them."""

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from proto.messages import OPEN_END, Beat, Message, Pose, PoseRequest, Recorded, Recording
from services.coordinator.dispatch import Identity

log = logging.getLogger(__name__)

_MOST_AT_ONCE = 64
"""Poses sent for one request."""
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


class _KeptPoses(dict[int, Pose]):
    """Published poses by frame."""

    forgotten_end = 0
    """One past the last frame that is no longer kept."""

    def add(self, pose: Pose, recorded_end: int) -> None:
        """Keep a pose, and drop the oldest ones before recorded_end if there are too many."""
        self[pose.frame] = pose
        while len(self) > _KEPT_POSES and (oldest := next(iter(self))) < recorded_end:
            del self[oldest]
            self.forgotten_end = oldest + 1


class Recorders:
    """Knows the recorders, and keeps each pose until as many as are expected have it on disk. Iterates over
    their identities.

    send(identity, message) -> False if that peer is gone.
    """

    def __init__(self, send: Callable[[Identity, Message], bool]) -> None:
        self._send = send
        self._known: dict[Identity, _Recorder] = {}
        self._run, self._n_expected, self._recorded_end = "", 0, 0
        self._first, self._settled = _KeptPoses(), _KeptPoses()
        self._returned: dict[int, Pose] = {}
        self._asked_back = range(0)
        self.foreign = 0
        """Number of messages of other runs."""
        self.heard_s = 0.0
        """When a recorder last got or confirmed frames, or the take ended."""
        self._told_lacking: set[Identity] = set()
        """Who was told that frames are no longer kept."""

    def __iter__(self) -> Iterator[Identity]:
        return iter(self._known)

    def register(self, identity: Identity, name: str) -> None:
        """Note a recorder that says hello, in place of its earlier connection."""
        self._known = {i: known for i, known in self._known.items() if known.name != name}
        self._add(identity, name)

    def _add(self, identity: Identity, name: str) -> None:
        """Note a recorder, and forget those that are gone, so that they do not become more and more."""
        here = {i: known for i, known in self._known.items() if self._send(i, Beat())}
        self._known = {**here, identity: _Recorder(name)}

    def _recordings(self) -> list[Recording]:
        return [known.recording for known in self._known.values() if known.recording is not None]

    @property
    def n_reported(self) -> int:
        """Number of recorders that have reported what they hold."""
        return len(self._recordings())

    def held(self, take: str, plan: str, n_expected: int) -> Recording | None:
        """What as many recorders as are expected, or one, hold of one earlier run of a plan.

        Others may hold less. None if too few hold something, or they hold something else.
        """
        needed = max(1, n_expected)
        held = sorted((one for one in self._recordings() if len(one.poses)), key=lambda one: -one.end_frame)
        if len(held) < needed:
            return None
        held = held[:needed]
        least = held[-1]
        same = all((one.take, one.plan, one.run) == (take, plan, least.run) for one in held)
        return least if same else None

    def begin(self, run: str, first_frame: int, n_expected: int) -> None:
        """Start a run from a frame on, for at least this many recorders."""
        self._run, self._n_expected = run, n_expected
        self._first.forgotten_end = self._recorded_end = first_frame

    @property
    def recorded_ends(self) -> dict[str, int]:
        """By name, the end of what each recorder has on disk of this run."""
        return {
            one.name: one.recording.end_frame if one.recording and one.recording.run == self._run else 0
            for one in self._known.values()
        }

    @property
    def n_unrecorded(self) -> int:
        """Poses that are kept because a recorder does not have them on disk yet."""
        return sum(frame >= self._recorded_end for frame in self._first)

    @property
    def n_lacking(self) -> int:
        """Poses that an expected recorder does not have on disk yet; 0 if none is expected."""
        return self.n_unrecorded if self._n_expected else 0

    @property
    def settled_end(self) -> int:
        """One past the last frame up to which the expected recorders have the settled poses of this run; 0
        while some have not reported."""
        return self._common_end(lambda recording: recording.settled_end)

    @property
    def least_settled_end(self) -> int:
        """The least end of the settled poses that recorders report of this run; 0 while none has."""
        return min((one.settled_end for one in self._recordings() if one.run == self._run), default=0)

    def _common_end(self, end_of: Callable[[Recording], int]) -> int:
        """The end up to which as many recorders as are expected have all frames of this run, or one; 0 while
        fewer have reported."""
        ends = sorted(
            (end_of(one) if one.run == self._run else 0 for one in self._recordings()), reverse=True
        )
        needed = max(1, self._n_expected)
        return ends[needed - 1] if len(ends) >= needed else 0

    def keep(self, pose: Pose) -> None:
        """Keep a published pose until as many recorders as are expected have it on disk."""
        if pose.settled:
            self._settled.add(pose, self.settled_end if self._n_expected else OPEN_END)
        else:
            self._first.add(pose, self._recorded_end if self._n_expected else OPEN_END)

    def ask_back(self, first_frame: int, end_frame: int) -> None:
        """Request the first poses of frames of this run from all recorders, see `take_returned`."""
        self._asked_back = range(first_frame, end_frame)
        for identity in self:
            self._send(identity, PoseRequest(run=self._run, first_frame=first_frame, end_frame=end_frame))

    def take_back(self, identity: Identity, pose: Pose) -> bool:
        """Add a pose that a recorder sends; False if it was not requested."""
        is_first = pose.run == self._run and not pose.settled
        is_asked_for = is_first and identity in self._known and pose.frame in self._asked_back
        if is_asked_for:
            self._returned[pose.frame] = pose
        return is_asked_for

    def take_returned(self) -> dict[int, Pose]:
        """The requested poses that have come since the last call, by frame."""
        returned, self._returned = self._returned, {}
        return returned

    def hear(self, identity: Identity, message: Recording | PoseRequest | Recorded) -> None:
        """Handle a message of a recorder, or a viewer's request for poses; for other runs only what is
        kept."""
        if isinstance(message, Recording):
            if identity in self._known:  # else a late message of a lost connection: hello comes first
                self._known[identity].recording, self.heard_s = message, time.monotonic()
                recorded_end = self._common_end(lambda recording: recording.end_frame)
                self._recorded_end = max(self._recorded_end, recorded_end)
        elif message.run != self._run:
            self.foreign += 1
        elif isinstance(message, PoseRequest):
            self._send_poses(identity, message)
        else:
            if identity not in self._known:  # it has reconnected and not registered yet
                self._add(identity, "a recorder")
            self._known[identity].end_frame, self.heard_s = message.end_frame, time.monotonic()

    def _send_poses(self, identity: Identity, request: PoseRequest) -> None:
        """Send what is kept of the requested poses. Raises LostFramesError if some are not, and without this
        recorder fewer than are expected have them: a viewer may miss some, and so may who comes besides."""
        kept = self._settled if request.settled else self._first
        if request.first_frame < kept.forgotten_end:
            name = self._known[identity].name if identity in self._known else "a viewer"
            problem = f"{name} lacks frame {request.first_frame}, which is no longer kept"
            others = [one.recording for i, one in self._known.items() if i != identity and one.recording]
            n_others = sum(one.run == self._run and one.end_frame > request.first_frame for one in others)
            if identity in self._known and n_others < self._n_expected:
                raise LostFramesError(f"{problem}: a restarted coordinator solves it again")
            if identity not in self._told_lacking:
                self._told_lacking.add(identity)
                log.warning("%s: it came too late to have results", problem)
        for frame in range(request.first_frame, request.end_frame)[:_MOST_AT_ONCE]:
            if frame not in kept:
                continue
            if not self._send(identity, kept[frame]):
                break  # its queue is full; it asks again
            self.heard_s = time.monotonic()

    def have_all(self, end_frame: int, handle_messages: Callable[[], None]) -> bool:
        """Whether all recorders, and as many as are expected, have confirmed all frames before end_frame.

        handle_messages: handles those that wait, because a recorder that has left may have confirmed before.
        """
        gone = [i for i in self._behind(end_frame) if not self._send(i, Beat())]
        if gone:
            handle_messages()
        for identity in set(gone) & self._behind(end_frame):
            log.warning("lost %s", self._known.pop(identity).name)
        n_whole = len(self._known.keys() - self._told_lacking)
        return n_whole >= self._n_expected and not self._behind(end_frame)

    def _behind(self, end_frame: int) -> set[Identity]:
        """Recorders that have not confirmed all frames before end_frame, but still can."""
        behind = {i for i, recorder in self._known.items() if recorder.end_frame < end_frame}
        return behind - self._told_lacking
