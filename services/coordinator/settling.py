"""Solves a recorded take again, both ways, once its last frame is solved."""

import time
from collections.abc import Callable, Collection, Iterator

import numpy as np

from proto.messages import Pose
from proto.streams import ASK_RECORDERS_AGAIN_S
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.recorders import LostFramesError, Recorders
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.search.both_ways import Step, solve_both_ways
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.silhouette_spool import SilhouetteSpool
from services.mocap.types import Floats

_ASK_FRAMES = 500
"""Poses are requested from recorders in as many at once."""
_RECORDERS_SILENT_S = 30.0
"""How long recorders may send nothing before this coordinator gives up."""


def fetch_poses(
    recorders: Recorders, frames: Collection[int], look: Callable[[], bool]
) -> dict[int, Pose] | None:
    """The first poses of frames, from recorders; None if a stop was requested meanwhile.

    look: handles messages; returns False once a stop was requested. Raises LostFramesError if recorders do
    not answer.
    """
    heard_s, asked_s, found = time.monotonic(), 0.0, dict[int, Pose]()
    while missing := sorted(set(frames) - found.keys()):
        now_s = time.monotonic()
        if returned := recorders.take_returned():
            found |= returned
            heard_s = now_s
        if now_s - heard_s > _RECORDERS_SILENT_S:
            raise LostFramesError(f"no recorder sends frame {missing[0]} back, which was solved before")
        if now_s - asked_s > ASK_RECORDERS_AGAIN_S:
            asked_s = now_s
            recorders.ask_back(missing[0], min(missing[0] + _ASK_FRAMES, missing[-1] + 1))
        if not look():
            return None
    return found


class Settling:
    """Keeps the silhouettes and the first poses of all frames, and settles them at the end."""

    def __init__(self, first_frame: int, fps: float) -> None:
        self._first_frame, self._fps = first_frame, fps
        self.seen = SilhouetteSpool()
        """Of the frames so far, from 0."""
        self._poses: dict[int, Floats] = {}

    @property
    def next_frame(self) -> int:
        """The frame whose silhouettes come next."""
        return self._first_frame + len(self.seen)

    def note(self, seen: TriPlanes, pose: Floats | None) -> None:
        """Add the next frame, with its pose (D,); None: a recorder has it, see `fetch`."""
        if pose is not None:
            self._poses[self.next_frame] = pose
        self.seen.append(seen)

    def fetch(self, recorders: Recorders, look: Callable[[], bool]) -> bool:
        """Get the poses that are missing, as `fetch_poses` does."""
        missing = set(range(self._first_frame, self.next_frame)) - self._poses.keys()
        returned = fetch_poses(recorders, missing, look)
        self._poses |= {frame: message.pose for frame, message in (returned or {}).items()}
        return returned is not None

    def solve(self, model: Model, settings: SearchSettings, limbs: RemoteLimbs) -> Iterator[tuple[int, Step]]:
        """Solve all frames both ways, step by step; yields the number of each step's frame, and the step."""
        frames = range(self._first_frame, self.next_frame)
        forward = np.array([self._poses[frame] for frame in frames])
        for step in solve_both_ways(model, settings, limbs, self.seen, forward, self._fps):
            yield frames[step.frame], step
            limbs.frame = frames[step.frame]
