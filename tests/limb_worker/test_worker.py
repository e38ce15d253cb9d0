"""A worker's coordinators take turns, whatever each of them gives."""

from proto.messages import LimbTask
from services.limb_worker.worker import Turns


def task(take: str, frame: int) -> LimbTask:
    return LimbTask.model_construct(take=take, frame=frame)


def taken(turns: Turns, times: int, *, without: tuple[str, ...] = ()) -> list[tuple[int, int]]:
    """Coordinators and frames, in the order in which they are served."""
    found = [turns.take(lambda held: held.take not in without) for _ in range(times)]
    return [(one[0], one[1].frame) for one in found if one is not None]


def test_coordinators_are_served_in_turn_and_each_in_its_order() -> None:
    turns = Turns(3)
    for frame in range(4):
        turns.add(0, task("greedy", frame))
    turns.add(2, task("modest", 7))
    turns.add(1, task("other", 5))
    assert taken(turns, 9) == [(0, 0), (1, 5), (2, 7), (0, 1), (0, 2), (0, 3)]


def test_whoever_comes_back_waits_for_one_task_of_each_other_at_most() -> None:
    turns = Turns(2)
    for frame in range(8):
        turns.add(0, task("greedy", frame))
    assert taken(turns, 2) == [(0, 0), (0, 1)]
    turns.add(1, task("modest", 0))
    assert taken(turns, 3) == [(1, 0), (0, 2), (0, 3)]


def test_a_task_that_lacks_something_holds_nobody_up() -> None:
    turns = Turns(2)
    for frame in range(2):
        turns.add(0, task("new", frame))
        turns.add(1, task("known", frame))
    turns.add(0, task("known too", 9))
    assert taken(turns, 9, without=("new",)) == [(0, 9), (1, 0), (1, 1)]
    assert [held.frame for _, held in turns] == [0, 1]
    assert taken(turns, 9) == [(0, 0), (0, 1)]


def test_a_flood_costs_only_its_sender() -> None:
    turns = Turns(2)
    turns.add(1, task("modest", 0))
    for frame in range(1000):
        turns.add(0, task("greedy", frame))
    assert len(turns) < 20
    assert taken(turns, 2) == [(0, 992), (1, 0)]


def test_a_coordinator_that_forgot_its_tasks_gets_none_solved() -> None:
    turns = Turns(2)
    turns.add(0, task("dead", 0))
    turns.add(1, task("alive", 0))
    turns.forget(0)
    assert taken(turns, 9) == [(1, 0)]
