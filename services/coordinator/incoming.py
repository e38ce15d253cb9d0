"""Which frame is solved next: of a recorded take every one, paced by credit; of live input the newest."""

from dataclasses import dataclass
from typing import Protocol

from proto.messages import Credit, LivePace, LiveSilhouettes, LiveSources, Silhouettes
from services.coordinator.assembly import FrameAssembler
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes

_AHEAD_FRAMES = 8
"""How far segmentation may be ahead of the fit."""


@dataclass(frozen=True, eq=False)
class Frame:
    """What is to be solved."""

    seen: TriPlanes
    """(P, H, W) of all cameras; empty for those that are absent."""
    time_s: float
    """In the take."""
    shot: int
    """Which of the cameras' shots it is."""
    absent: tuple[int, ...] = ()
    """Cameras that have no say."""
    shutter_s: float | None = None
    """When it was taken, by time.monotonic; None for recorded ones."""


@dataclass(frozen=True)
class LiveFigures:
    """How live input is doing; all empty for a recorded take."""

    latency_s: dict[str, float]
    drops: dict[str, list[int]]
    absent: list[str]


class Incoming(Protocol):
    """Takes in silhouettes, and says which frame is next."""

    @property
    def dropped(self) -> int:
        """Messages that belonged to another take, run or frame, or made no sense."""
        ...

    def begin(self, run: str, first_frame: int) -> None:
        """From now on this run counts, from a frame on."""
        ...

    def add(self, message: Silhouettes | LiveSilhouettes) -> None:
        """Take in some cameras' silhouettes; what is not wanted is counted and dropped."""
        ...

    def answer(self, sources: LiveSources) -> LivePace | None:
        """What to say to a segmentation's word about its cameras; None: nothing."""
        ...

    def credit(self) -> Credit | None:
        """How far segmentation may go; None where nobody asks."""
        ...

    def take_next(self) -> Frame | None:
        """The next frame, if it is there."""
        ...

    def catch_up(self) -> None:
        """The actor was found just now, which took long: frames since then should lead up to the newest."""
        ...

    def waiting_for(self) -> list[int]:
        """Cameras that the next frame still lacks."""
        ...

    def note_latency(self, frame: Frame) -> float:
        """A frame's pose goes out now; returns how long after the shutter, 0 for recorded ones."""
        ...

    @property
    def next_frame(self) -> int:
        """The frame that is handed out next."""
        ...

    @property
    def n_ready(self) -> int:
        """Whole frames that wait to be solved."""
        ...

    @property
    def has_ended(self) -> bool:
        """Whether no frame will follow those that were handed out."""
        ...

    @property
    def end_shot(self) -> int:
        """One past the last shot that belongs to a recording of the cameras; 0 for recorded takes."""
        ...

    def memory(self) -> dict[str, list[int]]:
        """What another one needs to go on after this one (recall)."""
        ...

    def recall(self, memory: dict[str, list[int]]) -> None:
        """Go on with what another one knew; raises ValueError where that makes no sense."""
        ...

    def figures(self) -> LiveFigures:
        """How live input is doing."""
        ...


class RecordedFrames:
    """Every frame of a recorded take, in order."""

    def __init__(self, take: str, rig: Rig, frames: range, fps: float) -> None:
        self._take, self._rig, self._range, self._fps = take, rig, frames, fps
        self._frames = FrameAssembler(take, "", rig, frames.start, frames.stop)
        self._run = ""

    def begin(self, run: str, first_frame: int) -> None:
        """See Incoming.begin."""
        early, self._run = self._frames, run
        self._frames = FrameAssembler(self._take, run, self._rig, first_frame, self._range.stop)
        self._frames.dropped = early.dropped

    @property
    def dropped(self) -> int:
        """See Incoming.dropped."""
        return self._frames.dropped

    def add(self, message: Silhouettes | LiveSilhouettes) -> None:
        """See Incoming.add."""
        if isinstance(message, Silhouettes):
            self._frames.add(message, self._credit_end)
        else:
            self._frames.dropped += 1

    def answer(self, sources: LiveSources) -> LivePace | None:  # noqa: ARG002
        """See Incoming.answer: there are no live cameras."""
        self._frames.dropped += 1
        return None

    @property
    def _credit_end(self) -> int:
        return min(self._frames.next_frame + _AHEAD_FRAMES, self._range.stop)

    def credit(self) -> Credit:
        """See Incoming.credit."""
        first = self._frames.first_lacking()
        return Credit(take=self._take, run=self._run, next_frame=first, end_frame=self._credit_end)

    def take_next(self) -> Frame | None:
        """See Incoming.take_next."""
        frame = self._frames.next_frame
        seen = self._frames.take_next()
        return None if seen is None else Frame(seen, frame / self._fps, frame)

    def catch_up(self) -> None:
        """See Incoming.catch_up: no frame is left out anyway."""

    def waiting_for(self) -> list[int]:
        """See Incoming.waiting_for."""
        return self._frames.waiting_for()

    def note_latency(self, frame: Frame) -> float:  # noqa: ARG002
        """See Incoming.note_latency."""
        return 0.0

    @property
    def next_frame(self) -> int:
        """See Incoming.next_frame."""
        return self._frames.next_frame

    @property
    def n_ready(self) -> int:
        """See Incoming.n_ready."""
        return self._frames.n_ready

    @property
    def has_ended(self) -> bool:
        """See Incoming.has_ended."""
        return False

    @property
    def end_shot(self) -> int:
        """See Incoming.end_shot."""
        return 0

    def memory(self) -> dict[str, list[int]]:
        """See Incoming.memory: where a run goes on says all."""
        return {}

    def recall(self, memory: dict[str, list[int]]) -> None:
        """See Incoming.recall."""

    def figures(self) -> LiveFigures:
        """See Incoming.figures."""
        return LiveFigures({}, {}, [])
