"""Whatever the order of losses, delays and replies: one result per task, and no task is forgotten."""

import numpy as np
from floor import Floor, pass_tasks, refusal_of, result_of
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from proto.messages import LimbResult, LimbTask
from services.coordinator.dispatch import FIRST_DEADLINE_S, Identity, Key, key_of

_NAMES = ("a", "b", "c")


class DispatchMachine(RuleBasedStateMachine):
    """Workers that come, solve, refuse, fall silent, vanish and return, in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.floor = Floor()
        self.frame = -1
        self.submitted: dict[Key, LimbTask] = {}
        self.collected: list[LimbResult] = []
        self.taken: list[LimbTask] = []
        self.sessions: list[Identity] = []

    def _given(self, data: st.DataObject) -> tuple[Identity, LimbTask] | None:
        """Any worker, here or gone, and any task that it was ever given."""
        known = [(identity, task) for identity, tasks in self.floor.inbox.items() for task in tasks]
        return data.draw(st.sampled_from(known)) if known else None

    @rule(name=st.sampled_from(_NAMES))
    def register(self, name: str) -> None:
        identity = f"{name}{len(self.sessions)}".encode()
        self.sessions.append(identity)
        self.floor.register(identity, name)

    @rule(data=st.data())
    def register_again_from_the_same_address(self, data: st.DataObject) -> None:
        if self.sessions:
            self.floor.register(data.draw(st.sampled_from(self.sessions)), data.draw(st.sampled_from(_NAMES)))

    @rule(data=st.data())
    def vanish(self, data: st.DataObject) -> None:
        if self.sessions:
            self.floor.gone.add(data.draw(st.sampled_from(self.sessions)))

    @rule(data=st.data())
    def beat(self, data: st.DataObject) -> None:
        if self.sessions:
            self.floor.dispatcher.heard(data.draw(st.sampled_from(self.sessions)))

    @rule(data=st.data(), kind=st.sampled_from(["result", "result", "refusal", "nonsense"]))
    def answer(self, data: st.DataObject, kind: str) -> None:
        given = self._given(data)
        if given is None:
            return
        identity, task = given
        if kind == "refusal":
            self.floor.dispatcher.finished(identity, refusal_of(task))
        else:
            values = np.full(3, 9.0) if kind == "nonsense" else None
            self.floor.dispatcher.finished(identity, result_of(task, values=values))

    @rule(data=st.data())
    def stranger_answers(self, data: st.DataObject) -> None:
        given = self._given(data)
        if given is not None:
            self.floor.dispatcher.finished(b"stranger", refusal_of(given[1]))

    @rule(seconds=st.sampled_from([0.0, 0.05, 0.3, 2.0, 11.0, FIRST_DEADLINE_S + 1.0]))
    def time_passes(self, seconds: float) -> None:
        self.floor.later(seconds)

    @rule()
    def coordinator_takes(self) -> None:
        task = self.floor.dispatcher.take_waiting()
        if task is not None:
            self.taken.append(task)

    @precondition(lambda self: self.taken)
    @rule()
    def coordinator_solves(self) -> None:
        self.floor.dispatcher.add_result(result_of(self.taken.pop(0)))

    @rule()
    def collect(self) -> None:
        self.collected += self.floor.dispatcher.collect()

    @precondition(lambda self: not self.floor.dispatcher.pending)
    @rule(shards=st.integers(1, 2))
    def submit(self, shards: int) -> None:
        self._all_solved_once()
        self.frame += 1
        tasks = pass_tasks(self.frame, shards)
        self.submitted, self.taken = {key_of(task): task for task in tasks}, []
        self.floor.dispatcher.submit(tasks)

    def _all_solved_once(self) -> None:
        self.collected += self.floor.dispatcher.collect()
        assert sorted(map(key_of, self.collected)) == sorted(self.submitted)
        self.collected = []

    @invariant()
    def no_result_twice_and_none_foreign(self) -> None:
        keys = [key_of(result) for result in self.collected]
        assert len(set(keys)) == len(keys)
        assert set(keys) <= set(self.submitted)

    @invariant()
    def no_worker_is_given_a_task_twice(self) -> None:
        for tasks in self.floor.inbox.values():
            keys = [key_of(task) for task in tasks]
            assert len(set(keys)) == len(keys)

    @invariant()
    def one_registration_per_name(self) -> None:
        assert self.floor.dispatcher.n_workers <= len(_NAMES)

    def teardown(self) -> None:
        """All workers fall silent; the coordinator finishes alone, in bounded time."""
        for task in self.taken:
            self.floor.dispatcher.add_result(result_of(task))
        for _ in range(2 * len(_NAMES) + 2):
            while (waiting := self.floor.dispatcher.take_waiting()) is not None:
                self.floor.dispatcher.add_result(result_of(waiting))
            self.floor.later(self.floor.dispatcher.deadline_s + 1.0)
        assert not self.floor.dispatcher.pending
        self._all_solved_once()


DispatchMachine.TestCase.settings = settings(
    max_examples=120, stateful_step_count=40, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
TestDispatchMachine = DispatchMachine.TestCase
