"""A worker's coordinators take turns, whatever each of them gives."""

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from proto.messages import BlobRequest, LimbRefusal, LimbTask, Message
from proto.streams import ASK_AGAIN_S
from services.limb_worker.worker import Worker
from services.mocap.body.kinematics import N_DOF
from services.mocap.energy.engine import open_engine
from services.mocap.energy.settings import EngineSettings

CPU = open_engine(EngineSettings(backend="cpu"))


class Shift:
    """A worker with make-believe coordinators and a make-believe solver."""

    def __init__(self, coordinators: int) -> None:
        self.answers = list[tuple[int, int]]()
        """Coordinators and the frames of their tasks, in the order in which they were served."""
        self.asked = list[int]()
        """Coordinators that were asked for content."""
        self.unknown = set[str]()
        """Takes whose content the worker lacks."""
        self.anew = set[int]()
        """Coordinators at which the worker registers again."""
        links: Any = [
            SimpleNamespace(send=partial(self._sent, number), tick=partial(self.anew.__contains__, number))
            for number in range(coordinators)
        ]
        self.worker = Worker(links, CPU)
        solver: Any = SimpleNamespace(
            blobs=SimpleNamespace(missing=lambda task: ["a" * 64] if task.take in self.unknown else []),
            solve=lambda task: LimbRefusal(**task.task_key, reason="on holiday"),
        )
        self.worker._solver = solver

    def _sent(self, number: int, message: Message) -> None:
        if isinstance(message, LimbRefusal):
            self.answers.append((number, message.frame))
        else:
            assert isinstance(message, BlobRequest)
            self.asked.append(number)

    def give(self, coordinator: int, take: str, frame: int) -> None:
        """A coordinator gives a task."""
        task = LimbTask(
            take=take, run="0" * 32, frame=frame, pass_index=0, limb="left_arm", shard=0, shards=1,
            actor="a" * 64, rig="b" * 64, search={}, pose=np.zeros(N_DOF),
            origin_px=np.zeros((1, 2), np.int32), window=np.zeros((1, 2, 2), np.uint8),
        )  # fmt: skip
        self.worker._act(coordinator, task)

    def served(self, times: int) -> list[tuple[int, int]]:
        """What is served while the worker works so many times."""
        before = len(self.answers)
        for _ in range(times):
            self.worker.work()
        return self.answers[before:]


def test_coordinators_that_give_one_task_after_the_other_are_served_in_turn() -> None:
    shift = Shift(3)
    for number in (0, 2, 1):
        shift.give(number, "walk", 0)
    for frame in range(1, 4):
        for number in (0, 2, 1):
            assert shift.served(1) == [(number, frame - 1)]
            shift.give(number, "walk", frame)
    assert shift.served(9) == [(0, 3), (2, 3), (1, 3)]


def test_whoever_comes_back_waits_for_one_task_of_each_other_at_most() -> None:
    shift = Shift(2)
    for frame in range(3):
        shift.give(0, "greedy", frame)
        assert shift.served(1) == [(0, frame)]
    shift.give(0, "greedy", 3)
    shift.give(1, "modest", 0)
    assert shift.served(1) == [(0, 3)]
    shift.give(0, "greedy", 4)
    assert shift.served(2) == [(1, 0), (0, 4)]


def test_a_task_that_lacks_something_holds_nobody_up() -> None:
    shift = Shift(2)
    shift.unknown.add("new")
    shift.give(0, "new", 0)
    for frame in range(3):
        shift.give(1, "known", frame)
        assert shift.served(2) == [(1, frame)]
    shift.give(1, "known", 3)
    shift.unknown.clear()
    assert shift.served(9) == [(0, 0), (1, 3)]


def test_a_flood_costs_only_its_sender() -> None:
    shift = Shift(2)
    for frame in range(1000):
        shift.give(0, "greedy", frame)
    shift.give(1, "modest", 0)
    for frame in range(1000, 2000):
        shift.give(0, "greedy", frame)
    assert shift.served(9) == [(0, 1999), (1, 0)]


def test_a_coordinator_that_forgot_its_tasks_gets_none_solved() -> None:
    shift = Shift(2)
    shift.give(0, "dead", 0)
    shift.give(1, "alive", 0)
    shift.anew.add(0)
    shift.worker.tick()
    assert shift.served(9) == [(1, 0)]


def test_content_that_does_not_come_is_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    shift, now_s = Shift(2), [100.0]
    monkeypatch.setattr("services.limb_worker.worker.time.monotonic", lambda: now_s[0])
    shift.unknown.add("new")
    shift.give(1, "new", 0)
    shift.worker.tick()
    assert shift.asked == [1]
    now_s[0] += 1.01 * ASK_AGAIN_S
    shift.give(0, "known", 0)  # of another coordinator, for whom nothing is to be asked
    shift.worker.tick()
    shift.worker.tick()
    assert shift.asked == [1, 1]
