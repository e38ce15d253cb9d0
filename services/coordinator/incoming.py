"""Chooses the next frame: every frame of a recorded take, paced by credit; the newest of live input."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from proto.messages import Credit, LivePace, LiveSilhouettes, LiveSources, Silhouettes
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, fit_together, joined

_AHEAD_FRAMES = 8
"""How far segmentation may be ahead of the fit."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame to solve."""

    seen: TriPlanes
    """(P, H, W) of all cameras; empty for those that are absent."""
    time_s: float
    """In the take."""
    shot: int
    """Which of the cameras' shots it is."""
    absent: tuple[int, ...] = ()
    """Cameras without a picture, which are not used."""
    shutter_s: float | None = None
    """When it was taken (time.monotonic); None for recorded frames."""
    is_late: bool = False
    """Whether a newer shot is waiting already."""


class Incoming(ABC):
    """Takes in silhouettes and says which frame is next; what is only of live input does nothing here."""

    is_live: ClassVar[bool] = False

    def __init__(self, rig: Rig) -> None:
        self._rig, self._run = rig, ""
        self.next_frame = 0
        """The next frame to return."""
        self.dropped = 0
        """Number of messages of another take, run or frame, or without sense."""

    def begin(self, run: str, first_frame: int) -> None:
        """Start this run, from a frame on."""
        self._run, self.next_frame = run, first_frame

    @abstractmethod
    def add(self, message: Silhouettes | LiveSilhouettes) -> bool:
        """Add some cameras' silhouettes; returns False for unwanted ones, which are counted and dropped."""

    def _fits(self, message: Silhouettes | LiveSilhouettes) -> bool:
        """Whether cameras and planes of a message suit each other and the rig."""
        cameras = message.cameras
        known = len(set(cameras)) == len(cameras) and max(cameras) < self._rig.n_cameras
        planes = message.planes, message.unsure, message.classes
        return known and fit_together(*planes, len(cameras), self._rig.shape_px)

    @abstractmethod
    def take_next(self) -> Frame | None:
        """The next frame, if it has arrived."""

    @abstractmethod
    def waiting_for(self) -> list[int]:
        """Cameras that the next frame still lacks."""

    @property
    @abstractmethod
    def n_ready(self) -> int:
        """Whole frames that wait to be solved."""

    def credit(self) -> Credit | None:
        """How far segmentation may go; None for live input."""
        return None

    def answer(self, sources: LiveSources) -> LivePace | None:  # noqa: ARG002
        """The answer to a segmentation's report on its cameras; None: no answer."""
        self.dropped += 1
        return None

    def catch_up(self) -> None:  # noqa: B027  (nothing to do for recorded takes)
        """Called after a long search for the actor: the following frames should lead up to the newest one."""

    def note_latency(self, frame: Frame, *, is_settled: bool) -> float:  # noqa: ARG002
        """Called when a frame's pose is published, the first or the settled one; returns the time since the
        shutter, 0 for recorded frames."""
        return 0.0

    @property
    def has_ended(self) -> bool:
        """Whether no more frames will follow."""
        return False

    @property
    def end_shot(self) -> int:
        """One past the last shot that belongs to a recording of the cameras; 0 for recorded takes."""
        return 0

    def memory(self) -> dict[str, list[int]]:
        """The state with which another coordinator can continue (see recall)."""
        return {}

    def recall(self, memory: dict[str, list[int]]) -> None:  # noqa: B027
        """Continue from another coordinator's state; raises ValueError if it is invalid."""

    def figures(self) -> dict[str, Any]:
        """How live input is doing: the fields of Telemetry that are live's own."""
        return {}


class RecordedFrames(Incoming):
    """Every frame of a recorded take, in order, put together from what several segmentations send."""

    def __init__(self, take: str, rig: Rig, frames: range, fps: float) -> None:
        super().__init__(rig)
        self._take, self._end, self._fps = take, frames.stop, fps
        self.next_frame = frames.start
        self._partial: dict[int, dict[int, tuple[TriPlanes, int]]] = {}
        """Planes of each camera that has come, and its place in them, by frame."""

    @property
    def _credit_end(self) -> int:
        """Frames from this one on were not asked for, so that memory stays bounded."""
        return min(self.next_frame + _AHEAD_FRAMES, self._end)

    def add(self, message: Silhouettes | LiveSilhouettes) -> bool:
        """See Incoming.add."""
        if (
            not isinstance(message, Silhouettes)
            or (message.take, message.run) != (self._take, self._run)
            or message.frame not in range(self.next_frame, self._credit_end)
            or not self._fits(message)
        ):
            self.dropped += 1
            return False
        planes = TriPlanes.of_sent(message.planes, message.unsure, message.classes)
        places = {camera: (planes, k) for k, camera in enumerate(message.cameras)}
        self._partial.setdefault(message.frame, {}).update(places)
        return True

    def credit(self) -> Credit:
        """See Incoming.credit."""
        first = self.next_frame + self.n_ready
        return Credit(take=self._take, run=self._run, next_frame=first, end_frame=self._credit_end)

    def take_next(self) -> Frame | None:
        """See Incoming.take_next."""
        if not self.n_ready:
            return None
        frame, places = self.next_frame, self._partial.pop(self.next_frame)
        self.next_frame += 1
        return Frame(joined([places[c] for c in range(self._rig.n_cameras)]), frame / self._fps, frame)

    @property
    def n_ready(self) -> int:
        """See Incoming.n_ready."""
        frame = self.next_frame
        while len(self._partial.get(frame, {})) == self._rig.n_cameras:
            frame += 1
        return frame - self.next_frame

    def waiting_for(self) -> list[int]:
        """See Incoming.waiting_for."""
        have = self._partial.get(self.next_frame, {})
        return [c for c in range(self._rig.n_cameras) if c not in have]
