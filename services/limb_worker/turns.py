"""Chooses the next task: coordinators that share a worker are served in turn, one task each."""

from collections import deque
from collections.abc import Callable, Iterator

from proto.messages import LimbTask

_TASKS_HELD = 8
"""At most this many tasks of one coordinator are held; the oldest is dropped first. A correct coordinator
sends one at a time."""


class Turns:
    """A worker's tasks that it has not started, by coordinator, numbered from 0."""

    def __init__(self, coordinators: int) -> None:
        self._held: list[deque[LimbTask]] = [deque(maxlen=_TASKS_HELD) for _ in range(coordinators)]
        self._next = 0

    def __len__(self) -> int:
        return sum(len(held) for held in self._held)

    def __iter__(self) -> Iterator[tuple[int, LimbTask]]:
        """All tasks that are held, with their coordinators' numbers."""
        return ((number, task) for number, held in enumerate(self._held) for task in held)

    def add(self, coordinator: int, task: LimbTask) -> None:
        """Hold a task; a coordinator that sends too many loses its oldest, and none of another's."""
        self._held[coordinator].append(task)

    def forget(self, coordinator: int) -> None:
        """Drop the tasks of a coordinator that no longer waits for them."""
        self._held[coordinator].clear()

    def take(self, is_ready: Callable[[LimbTask], bool]) -> tuple[int, LimbTask] | None:
        """The next task and its coordinator; None if none is ready.

        A coordinator without a ready task loses only this turn.
        """
        for step in range(len(self._held)):
            number = (self._next + step) % len(self._held)
            task = next((held for held in self._held[number] if is_ready(held)), None)
            if task is not None:
                self._held[number].remove(task)
                self._next = (number + 1) % len(self._held)
                return number, task
        return None
