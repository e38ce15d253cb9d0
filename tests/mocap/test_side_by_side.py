"""Cameras and frames are worked on at the same time."""

import os
import threading
import time

import pytest

from services.mocap.side_by_side import side_by_side


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="on one core it is done one after the other")
def test_results_come_in_order_although_work_is_done_at_the_same_time() -> None:
    both = threading.Barrier(2, timeout=10)

    def work(camera: int) -> int:
        both.wait()  # no work would end if one were done after the other
        return 10 * camera

    assert side_by_side(work, [3, 1]) == [30, 10]
    assert side_by_side(work, []) == []


def test_what_work_raises_is_raised() -> None:
    def work(camera: int) -> int:
        if camera:
            raise ValueError(f"camera {camera}")
        return camera

    with pytest.raises(ValueError, match="camera 1"):
        side_by_side(work, [0, 1, 2])


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="on one core it is done one after the other")
def test_no_work_goes_on_after_something_was_raised() -> None:
    begun, done = threading.Event(), list[int]()

    def work(camera: int) -> None:
        if camera == 0:
            assert begun.wait(10.0)
            raise ValueError("camera 0")
        begun.set()
        time.sleep(0.05)
        done.append(camera)

    with pytest.raises(ValueError, match="camera 0"):
        side_by_side(work, range(50))
    n_done = len(done)
    assert 1 <= n_done < 49
    time.sleep(0.1)
    assert len(done) == n_done
