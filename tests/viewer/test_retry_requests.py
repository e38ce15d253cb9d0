"""Requests that nobody answers end, and frames that others have are asked for all the same."""

from itertools import pairwise

from services.viewer.archive import RetryRequests


def test_the_same_frames_are_asked_for_a_few_times_and_then_let_be() -> None:
    requests = RetryRequests()
    asked = [tick for tick in range(100) if requests.asks(range(10, 20), 0.1 * tick, heard_s=0.1 * tick)]
    assert len(asked) == 3
    assert all(later - earlier >= 4 for earlier, later in pairwise(asked))
    assert requests.gone_end == 20
    assert not requests.asks(range(5, 12), 100.0, heard_s=100.0)
    assert requests.asks(range(20, 30), 200.0, heard_s=200.0)


def test_of_a_silent_coordinator_nothing_follows() -> None:
    requests = RetryRequests()
    assert sum(requests.asks(range(10), 0.5 * tick, heard_s=-1.0) for tick in range(50)) == 50
    assert requests.gone_end == 0


def test_frames_that_come_in_parts_are_never_let_be() -> None:
    requests = RetryRequests()
    assert all(requests.asks(range(start, 64), float(start), heard_s=float(start)) for start in range(60))
    assert requests.gone_end == 0
