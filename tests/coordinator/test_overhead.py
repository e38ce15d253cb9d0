"""What is fitting and what is not, however one is within the other."""

import time

import pytest

from services.coordinator.overhead import Overhead


def work(seconds: float) -> None:
    end_s = time.thread_time() + seconds
    while time.thread_time() < end_s:
        pass


def test_talking_within_fitting_within_a_frame() -> None:
    overhead = Overhead()
    work(0.02)
    with overhead.fitting():
        work(0.05)
        with overhead.talking():
            work(0.01)
            with overhead.fitting():
                work(0.03)
            time.sleep(0.05)  # waiting takes no processor
        work(0.02)
    assert overhead.end_frame() == pytest.approx(0.03, abs=0.005)
    with overhead.fitting():
        work(0.01)
    assert overhead.end_frame() < 0.005
