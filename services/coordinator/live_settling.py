"""Settles live frames a moment after they were solved, in the time that the newest frames leave."""

from collections import deque
from collections.abc import Callable, Iterator

from services.coordinator.incoming import Frame
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.settling import SWEEPS
from services.mocap.search.both_ways import Step
from services.mocap.search.fixed_lag import FixedLag
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
        self._at = first_frame, 0
        """The frame and the sweep of the next step."""
        self._n_blocks = 0

    def note(self, frame: Frame, solution: FrameSolution) -> None:
        """Add the next frame and its first solution."""
        self._frames.append(frame)
        self._lag.note(frame.seen, frame.absent, frame.time_s, solution)

    def work(self) -> bool:
        """Do one step: solve a frame, or publish one; False if there is nothing to do yet."""
        first = self._limbs.frame, self._limbs.sweep
        self._limbs.frame, self._limbs.sweep = self._at
        step = next(self._steps, None)
        self._limbs.frame, self._limbs.sweep = first
        if step is None:
            self._steps = self._lag.settle()
            step = next(self._steps, None)
            if step is None:
                return False
            self._n_blocks += 1
        # A frame is tracked back twice, before its own block is settled and with it.
        is_second = step.sweep == "tracking back" and self._n_blocks % 2
        self._at = step.frame, len(SWEEPS) + 1 if is_second else SWEEPS[step.sweep]
        self._note(step)
        return True

    def conclude(self) -> None:
        """Publish the frames that wait, as they are, because no others will come."""
        self._steps = iter(())
        for step in self._lag.unchanged():
            self._note(step)

    def _note(self, step: Step) -> None:
        if step.solution is not None:
            self._publish(step.frame, self._frames.popleft(), step.solution)
