"""Whose task comes next: coordinators that share a worker are served in turn, one task each."""

from collections import deque
from collections.abc import Callable, Iterator

from proto.messages import LimbTask

_TASKS_HELD = 8
"""Tasks of one coordinator that are held, at most; the oldest goes first. A sound one gives one at a time."""


class Turns:
    """The tasks that coordinators, numbered from 0, have given to a worker and that it has not begun."""

    def __init__(self, coordinators: int) -> None:
        self._held: list[deque[LimbTask]] = [deque(maxlen=_TASKS_HELD) for _ in range(coordinators)]
        self._next = 0

    def __len__(self) -> int:
        return sum(len(held) for held in self._held)

    def __iter__(self) -> Iterator[tuple[int, LimbTask]]:
        """All tasks that are held, with their coordinators' numbers."""
        return ((number, task) for number, held in enumerate(self._held) for task in held)

    def add(self, coordinator: int, task: LimbTask) -> None:
        """Hold a task; whoever gives many loses his oldest, and takes no place from others."""
        self._held[coordinator].append(task)

    def forget(self, coordinator: int) -> None:
        """Let go of the tasks of a coordinator that does not wait for them any more."""
        self._held[coordinator].clear()

    def take(self, is_ready: Callable[[LimbTask], bool]) -> tuple[int, LimbTask] | None:
        """The task whose turn it is and its coordinator; None where none is ready.

        Whoever has nothing that is ready loses this turn only.
        """
        for step in range(len(self._held)):
            number = (self._next + step) % len(self._held)
            task = next((held for held in self._held[number] if is_ready(held)), None)
            if task is not None:
                self._held[number].remove(task)
                self._next = (number + 1) % len(self._held)
                return number, task
        return None
