"""Settles live frames a moment after they were solved, in the time that the newest frames leave."""

from collections import deque
from collections.abc import Callable, Iterator

import numpy as np

from services.coordinator.incoming import Frame
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.settling import fetch_poses
from services.coordinator.switchboard import Switchboard
from services.mocap.body.kinematics import N_DOF
from services.mocap.search.both_ways import Step
from services.mocap.search.fixed_lag import FixedLag, Tracked
from services.mocap.search.found import FrameSolution
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings


class LiveSettling:
    """Does the work step by step, so that no new frame waits longer than for one step."""

    def __init__(
        self,
        model: Model,
        settings: SearchSettings,
        limbs: RemoteLimbs,
        first_frame: int,
        publish: Callable[[int, Frame, FrameSolution], None],
    ) -> None:
        """first_frame: the number of the first frame. publish: takes a frame's number, the frame and its
        final solution."""
        self._lag = FixedLag(model, settings, limbs, first_frame)
        self._limbs, self._publish = limbs, publish
        self._frames = deque[Frame]()
        """Those that are not settled."""
        self._steps: Iterator[Step] = iter(())
        self._at = first_frame
        """The frame of the next step."""

    def note(self, frame: Frame, solution: FrameSolution, memory: dict[str, list[int]]) -> None:
        """Add the next frame, its first solution and the tracker's memory after it.

        Where newer frames leave too little time to settle it, older ones are published as they are.
        """
        self._frames.append(frame)
        self._lag.note(Tracked(frame.seen, frame.absent, frame.time_s, solution, memory))
        if self._lag.is_late:
            self._steps = iter(())
            for step in self._lag.catch_up():
                self._publish_step(step)

    def work(self) -> bool:
        """Do one step: solve a frame, or publish one; False if there is nothing to do yet."""
        newest, self._limbs.frame = self._limbs.frame, self._at
        step = next(self._steps, None)
        self._limbs.frame = newest
        if step is None:
            self._steps = self._lag.settle()
            step = next(self._steps, None)
            if step is None:
                return False
        self._at = step.frame
        self._publish_step(step)
        return True

    def conclude(self) -> None:
        """Publish the frames that wait, as they are, because no others will come."""
        self._steps = iter(())
        for step in self._lag.unchanged():
            self._publish_step(step)

    def _publish_step(self, step: Step) -> None:
        if step.solution is not None:
            self._publish(step.frame, self._frames.popleft(), step.solution)


def settle_unchanged(board: Switchboard, end_frame: int, look: Callable[[], bool]) -> bool:
    """Settle the live frames of an earlier coordinator, those before end_frame, as they are, because their
    silhouettes are gone; False if a stop was requested meanwhile.

    look: see fetch_poses.
    """
    unsettled = range(board.recorders.least_settled_end, end_frame)
    first = fetch_poses(board.recorders, unsettled, look)
    if first is None:
        return False
    final = {"settled": True, "memory": {}, "steady": np.zeros((0, N_DOF))}
    for frame in unsettled:
        board.publish(first[frame].model_copy(update=final))
    return True
