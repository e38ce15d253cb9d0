"""Limb tasks find a solver whatever becomes of the workers."""

import numpy as np
import pytest
from floor import Floor, limb_task, limbs_of, pass_tasks, refusal_of, result_of

from proto.messages import MAX_BACKENDS, LimbRefusal, LimbResult
from proto.streams import FROM_CLIENTS, TO_CLIENTS
from services.coordinator.dispatch import FIRST_DEADLINE_S, key_of
from services.mocap.body.skeleton import UPPER
from services.mocap.search.chains import LIMBS
from services.mocap.take.marks import LIMB_NAMES, LimbName


@pytest.fixture
def floor() -> Floor:
    return Floor()


def test_each_worker_gets_a_task_of_its_own(floor: Floor) -> None:
    workers = floor.workers(4)
    floor.dispatcher.submit(pass_tasks())
    assert [len(floor.inbox[worker]) for worker in workers] == [1, 1, 1, 1]
    assert limbs_of([floor.latest(worker) for worker in workers]) == limbs_of(pass_tasks())
    assert floor.dispatcher.pending
    floor.solve(*workers)
    assert not floor.dispatcher.pending
    assert limbs_of(floor.dispatcher.collect()) == limbs_of(pass_tasks())
    assert floor.dispatcher.collect() == []
    assert (floor.dispatcher.retries, floor.dispatcher.dropped) == (0, 0)


def test_more_tasks_than_workers_are_given_one_after_the_other(floor: Floor) -> None:
    one, two = floor.workers(2)
    floor.dispatcher.submit(pass_tasks(shards=2))
    assert floor.n_given() == 2
    while floor.dispatcher.pending:
        floor.solve(one)
        if floor.dispatcher.pending:
            floor.solve(two)
    assert limbs_of(floor.dispatcher.collect()) == limbs_of(pass_tasks(shards=2))
    assert len(floor.inbox[one]) == len(floor.inbox[two]) == 4
    assert floor.dispatcher.retries == 0


def test_more_workers_than_tasks_leaves_some_idle(floor: Floor) -> None:
    floor.workers(9)
    floor.dispatcher.submit(pass_tasks())
    assert floor.n_given() == 4
    assert floor.dispatcher.take_waiting() is None


def test_without_workers_the_coordinator_gets_all(floor: Floor) -> None:
    floor.dispatcher.submit(pass_tasks())
    taken = []
    while (task := floor.dispatcher.take_waiting()) is not None:
        taken.append(task)
        floor.dispatcher.add_result(result_of(task))
    assert limbs_of(taken) == limbs_of(pass_tasks())
    assert not floor.dispatcher.pending
    assert limbs_of(floor.dispatcher.collect()) == limbs_of(pass_tasks())
    assert floor.dispatcher.retries == 0


def test_a_worker_that_comes_late_joins_in(floor: Floor) -> None:
    floor.dispatcher.submit(pass_tasks())
    floor.register(b"late")
    assert floor.n_given() == 1
    assert floor.dispatcher.n_workers == 1


def test_a_second_result_is_dropped(floor: Floor) -> None:
    workers = floor.workers(4)
    floor.dispatcher.submit(pass_tasks())
    first = floor.latest(workers[0])
    floor.dispatcher.finished(workers[0], result_of(first, 5.0))
    floor.dispatcher.finished(workers[0], result_of(first, 4.0))
    floor.dispatcher.finished(workers[1], result_of(first, 3.0))
    assert [result.energy_px for result in floor.dispatcher.collect()] == [5.0]
    assert floor.dispatcher.dropped == 2


@pytest.mark.parametrize(
    "changed",
    [
        {"take": "run"},
        {"run": "f" * 32},
        {"frame": 1},
        {"pass_index": 1},
        {"limb": "left_leg"},
        {"shard": 1},
        {"shards": 2},
    ],
)
def test_foreign_results_and_refusals_are_dropped(floor: Floor, changed: dict[str, object]) -> None:
    (worker,) = floor.workers(1)
    floor.dispatcher.submit([limb_task("left_arm")])
    task = limb_task("left_arm").model_copy(update=changed)
    floor.dispatcher.finished(worker, result_of(task))
    floor.dispatcher.finished(worker, refusal_of(task))
    assert floor.dispatcher.dropped == 2
    assert floor.dispatcher.pending
    assert floor.dispatcher.take_waiting() is None
    floor.solve(worker)
    assert len(floor.dispatcher.collect()) == 1


@pytest.mark.parametrize("limb", LIMB_NAMES)
def test_a_result_that_makes_no_sense_counts_as_none(floor: Floor, limb: LimbName) -> None:
    one, two = floor.workers(2)
    dofs = list(LIMBS[limb].dofs)
    floor.dispatcher.submit([limb_task(limb)])
    beyond = np.zeros(len(dofs))
    beyond[3] = np.nextafter(UPPER[dofs[3]], np.inf)
    floor.dispatcher.finished(one, result_of(limb_task(limb), values=np.zeros(len(dofs) - 1)))
    assert floor.latest(two).limb == limb
    floor.dispatcher.finished(two, result_of(limb_task(limb), values=beyond))
    assert floor.dispatcher.dropped == 2
    assert floor.dispatcher.pending
    assert floor.dispatcher.collect() == []
    assert floor.dispatcher.take_waiting() is not None
    at_limits = result_of(limb_task(limb), values=UPPER[dofs])
    floor.dispatcher.finished(one, at_limits)
    assert floor.dispatcher.collect() == [at_limits]


def test_a_refused_task_goes_to_each_other_worker_then_to_the_coordinator(floor: Floor) -> None:
    one, two = floor.workers(2)
    floor.dispatcher.submit([limb_task()])
    floor.dispatcher.finished(one, refusal_of(limb_task()))
    floor.dispatcher.finished(two, refusal_of(limb_task()))
    assert floor.n_given() == 2
    assert len(floor.inbox[one]) == len(floor.inbox[two]) == 1
    assert floor.dispatcher.take_waiting() is not None
    assert floor.dispatcher.retries == 2


def test_a_strangers_refusal_moves_nothing(floor: Floor) -> None:
    floor.workers(2)
    floor.dispatcher.submit([limb_task()])
    floor.dispatcher.finished(b"stranger", refusal_of(limb_task()))
    assert floor.n_given() == 1
    assert floor.dispatcher.take_waiting() is None


def test_a_lost_workers_task_goes_to_another(floor: Floor) -> None:
    one, two = floor.workers(2)
    floor.dispatcher.submit([limb_task("left_arm"), limb_task("right_arm")])
    floor.solve(two)
    floor.gone.add(one)
    floor.later(TO_CLIENTS.every_s)
    assert floor.dispatcher.n_workers == 1
    assert floor.latest(two) == floor.inbox[one][0]
    floor.solve(two)
    assert not floor.dispatcher.pending
    assert len(floor.dispatcher.collect()) == 2
    assert floor.dispatcher.retries == 1


def test_a_lost_workers_task_waits_for_whoever_is_free(floor: Floor) -> None:
    one, two = floor.workers(2)
    floor.dispatcher.submit([limb_task("left_arm"), limb_task("right_arm")])
    floor.gone.add(one)
    floor.later(TO_CLIENTS.every_s)
    waiting = floor.dispatcher.take_waiting()
    assert waiting is not None
    assert waiting.limb == floor.inbox[one][0].limb
    assert floor.dispatcher.retries == 1
    assert floor.n_given() == 2
    assert two in floor.inbox


def test_losing_a_worker_while_handing_out(floor: Floor) -> None:
    one, two = floor.workers(2)
    floor.gone.add(one)
    floor.dispatcher.submit([limb_task()])
    assert floor.dispatcher.n_workers == 1
    assert len(floor.inbox[two]) == 1
    assert floor.dispatcher.retries == 0


def test_the_last_word_of_a_lost_worker_still_counts(floor: Floor) -> None:
    (one,) = floor.workers(1)
    floor.dispatcher.submit([limb_task()])
    floor.gone.add(one)
    floor.later(TO_CLIENTS.every_s)
    assert floor.dispatcher.n_workers == 0
    floor.dispatcher.finished(one, result_of(limb_task()))
    assert not floor.dispatcher.pending
    assert floor.dispatcher.take_waiting() is None
    assert len(floor.dispatcher.collect()) == 1


def test_a_late_task_is_given_to_each_other_worker_once(floor: Floor) -> None:
    workers = floor.workers(3)
    floor.dispatcher.submit([limb_task()])
    for n_asked in (2, 3, 3, 3):
        floor.later(FIRST_DEADLINE_S + 0.1, beating=workers[n_asked - 1 :])
        assert floor.n_given() == n_asked
    assert [len(floor.inbox[worker]) for worker in workers] == [1, 1, 1]
    assert floor.dispatcher.retries == 2
    assert floor.dispatcher.take_waiting() is not None
    assert floor.dispatcher.retries == 3


def test_before_its_deadline_nothing_is_given_twice(floor: Floor) -> None:
    floor.workers(2)
    floor.dispatcher.submit([limb_task()])
    floor.later(FIRST_DEADLINE_S - 0.1)
    assert floor.n_given() == 1
    assert floor.dispatcher.take_waiting() is None


def test_the_deadline_follows_what_tasks_usually_take(floor: Floor) -> None:
    (one,) = floor.workers(1)
    for frame, seconds in enumerate([0.1] * 60):
        floor.dispatcher.submit([limb_task(frame=frame)])
        floor.now_s += seconds
        floor.solve(one)
    assert floor.dispatcher.deadline_s == pytest.approx(0.5 + 0.1, abs=1e-6)


def test_the_deadline_grants_what_tasks_differ_by(floor: Floor) -> None:
    (one,) = floor.workers(1)
    for frame, seconds in enumerate([0.1, 0.3] * 40):
        floor.dispatcher.submit([limb_task(frame=frame)])
        floor.now_s += seconds
        floor.solve(one)
    assert floor.dispatcher.deadline_s == pytest.approx(0.5 + 0.2 + 4 * 0.1, abs=0.05)


def test_a_hedged_tasks_duration_is_that_of_who_solved_it(floor: Floor) -> None:
    one, two = floor.workers(2)
    floor.dispatcher.submit([limb_task()])
    floor.later(FIRST_DEADLINE_S + 1.0, beating=[two])
    assert len(floor.inbox[two]) == 1
    floor.now_s += 1.0
    floor.solve(one)
    assert floor.dispatcher.deadline_s == pytest.approx(0.5 + (1 + 4 / 2) * (FIRST_DEADLINE_S + 2.0))


def test_an_idle_worker_that_is_silent_is_forgotten_until_it_is_heard_again(floor: Floor) -> None:
    floor.workers(2)
    floor.now_s += FROM_CLIENTS.silence_s
    assert floor.dispatcher.heard(b"w1")
    floor.later(0.1)
    assert list(floor.dispatcher.workers) == ["w1"]
    assert floor.dispatcher.heard(b"w0") and not floor.dispatcher.heard(b"w2")
    floor.dispatcher.submit(pass_tasks())
    assert [len(floor.inbox[worker]) for worker in (b"w0", b"w1")] == [1, 1]


def test_a_worker_that_is_back_gets_what_waits_at_once(floor: Floor) -> None:
    (one,) = floor.workers(1)
    floor.later(FROM_CLIENTS.silence_s + 0.1)
    floor.dispatcher.submit([limb_task()])
    assert one not in floor.inbox
    assert floor.dispatcher.heard(one)
    assert floor.latest(one).limb == "left_arm"


def test_a_worker_that_registers_anew_is_not_there_twice(floor: Floor) -> None:
    floor.workers(1)
    floor.later(FROM_CLIENTS.silence_s + 0.1)
    assert floor.dispatcher.n_workers == 0
    floor.register(b"other connection", "w0")
    assert not floor.dispatcher.heard(b"w0")
    assert floor.dispatcher.n_workers == 1


def test_a_worker_that_solves_may_be_silent(floor: Floor) -> None:
    floor.workers(1)
    floor.dispatcher.submit([limb_task()])
    floor.later(3 * FROM_CLIENTS.silence_s)
    assert floor.dispatcher.n_workers == 1


def test_a_worker_that_beats_long_after_it_was_given_a_task_is_free_again(floor: Floor) -> None:
    """Its task or its result got lost; it must not stay without work for ever."""
    (one,) = floor.workers(1)
    floor.dispatcher.submit([limb_task(frame=0)])
    floor.later(FIRST_DEADLINE_S + 1.0)
    task = floor.dispatcher.take_waiting()
    assert task is not None
    floor.dispatcher.add_result(result_of(task))
    floor.dispatcher.submit([limb_task(frame=1)])
    assert floor.n_given() == 1
    assert floor.dispatcher.heard(one)
    floor.dispatcher.tick()
    assert floor.latest(one).frame == 1


def test_registering_anew_under_the_same_name_replaces(floor: Floor) -> None:
    floor.register(b"before", "worker@host:1")
    floor.dispatcher.submit([limb_task()])
    floor.register(b"after", "worker@host:1")
    assert floor.dispatcher.n_workers == 1
    assert floor.latest(b"after") == floor.latest(b"before")
    assert floor.dispatcher.retries == 1
    assert not floor.dispatcher.heard(b"before")


@pytest.mark.parametrize("name", ["same", "other"])
def test_registering_anew_from_the_same_address_gives_its_task_back(floor: Floor, name: str) -> None:
    floor.register(b"one", "same")
    floor.dispatcher.submit([limb_task()])
    floor.register(b"one", name)
    assert floor.dispatcher.n_workers == 1
    assert floor.dispatcher.take_waiting() is not None


def test_strangers_are_not_heard(floor: Floor) -> None:
    assert not floor.dispatcher.heard(b"stranger")
    assert floor.dispatcher.n_workers == 0


def test_submitting_gives_up_what_was_open(floor: Floor) -> None:
    one, two = floor.workers(2)
    floor.dispatcher.submit([limb_task(frame=0)])
    floor.dispatcher.submit([limb_task(frame=1)])
    assert floor.latest(two).frame == 1
    floor.dispatcher.finished(one, result_of(limb_task(frame=0)))
    assert floor.dispatcher.dropped == 1
    floor.dispatcher.finished(two, result_of(limb_task(frame=1)))
    assert [result.frame for result in floor.dispatcher.collect()] == [1]


def test_tasks_results_and_refusals_are_known_by_the_same_key() -> None:
    task = limb_task("right_leg", frame=4, shard=1, shards=2)
    answers: list[LimbResult | LimbRefusal] = [result_of(task), refusal_of(task)]
    expected = ("walk", task.run, 4, 0, "right_leg", 1, 2)
    assert {key_of(task)} == {key_of(answer) for answer in answers} == {expected}


def test_results_that_count_are_told_apart_by_backend(floor: Floor) -> None:
    one, two = floor.workers(2)
    floor.dispatcher.submit(pass_tasks())
    on_gpu = result_of(floor.latest(one)).model_copy(update={"backend": "gl"})
    floor.dispatcher.finished(one, on_gpu)
    floor.dispatcher.finished(one, on_gpu)  # nobody waits for it any more
    floor.solve(two)
    task = floor.dispatcher.take_waiting()
    if task is not None:
        floor.dispatcher.add_result(result_of(task))
    assert floor.dispatcher.helped == {"gl": 1, "cpu": 1}


def test_more_backends_than_a_message_holds_are_no_harm(floor: Floor) -> None:
    (worker,) = floor.workers(1)
    for n in range(MAX_BACKENDS + 5):
        floor.dispatcher.submit([limb_task("left_arm", frame=n)])
        named = {"backend": f"mine {n}"}
        floor.dispatcher.finished(worker, result_of(floor.latest(worker)).model_copy(update=named))
    assert len(floor.dispatcher.helped) == MAX_BACKENDS
