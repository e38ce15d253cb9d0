"""Live frames are settled in blocks, in order, with what the frames after them show."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.search.both_ways import Step
from services.mocap.search.chains import LIMBS
from services.mocap.search.fixed_lag import FixedLag, Tracked
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.take.marks import Part
from services.mocap.types import Floats

SETTINGS = SearchSettings()
N, FPS, BLOCK = 9, 10.0, 3
LOST = slice(1, 5)
"""Frames in which the left arm is lost."""


@pytest.fixture(scope="module")
def truth(sinking_arms: Floats) -> Floats:
    return sinking_arms[:N]


@pytest.fixture(scope="module")
def seen(sinking_arms_seen: list[TriPlanes]) -> list[TriPlanes]:
    return sinking_arms_seen[:N]


@pytest.fixture(scope="module")
def forward(truth: Floats, standing: Callable[..., Floats]) -> list[FrameSolution]:
    """The left arm hangs down in some frames, where it is not; nothing is marked."""
    poses, dofs = truth.copy(), list(LIMBS["left_arm"].dofs)
    poses[LOST, dofs[0] : dofs[-1] + 1] = standing(shoulder_elevation=-80.0)[dofs]
    return [FrameSolution(pose, 100.0) for pose in poses]


def marked(solutions: list[FrameSolution], frames: set[int], part: Part) -> list[FrameSolution]:
    return [
        replace(solution, distrusted=[part] if k in frames else []) for k, solution in enumerate(solutions)
    ]


def settled(lag: FixedLag, seen: list[TriPlanes], solutions: list[FrameSolution], fps: float) -> list[Step]:
    """All steps, when each frame is noted and then everything is done that can be done."""
    steps = list[Step]()
    for frame, (planes, solution) in enumerate(zip(seen, solutions, strict=True)):
        lag.note(Tracked(planes, (), frame / fps, solution, {}))
        steps += lag.settle()
    return steps


def test_a_lost_limb_is_found_on_the_way_back(
    model: Model,
    truth: Floats,
    seen: list[TriPlanes],
    forward: list[FrameSolution],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    lag = FixedLag(model, SETTINGS, LocalLimbs(model), 100)
    steps = settled(lag, seen, marked(forward, {2, 4}, "left_arm"), FPS)
    solved = [(step.frame, step.solution) for step in steps if step.solution is not None]
    assert [frame for frame, _ in solved] == [100, 101, 102]
    assert [step.frame for step in steps if step.sweep == "tracking back"] == list(range(105, 99, -1))
    for (_, solution), pose in zip(solved, truth, strict=False):
        assert joint_errors_mm(solution.pose, pose).max() < 25
        assert solution.distrusted == []


def test_blocks_without_a_doubt_stay_as_they_are(
    model: Model, seen: list[TriPlanes], forward: list[FrameSolution]
) -> None:
    lag = FixedLag(model, SETTINGS, LocalLimbs(model), 0)
    steps = settled(lag, seen, forward, FPS)
    rest = list(lag.unchanged())
    assert [step.frame for step in steps + rest] == list(range(N))
    assert [step.solution for step in steps + rest] == forward
    assert len(steps) == BLOCK
    assert list(lag.unchanged()) == []


def test_frames_of_a_lost_actor_and_frames_that_come_too_fast_stay_as_they_are(
    model: Model, seen: list[TriPlanes], forward: list[FrameSolution]
) -> None:
    lost = marked(marked(forward, {1}, "left_arm"), {3}, "torso")
    steps = settled(FixedLag(model, SETTINGS, LocalLimbs(model), 0), seen, lost, FPS)
    assert [step.solution for step in steps] == lost[:BLOCK]
    lag, late = FixedLag(model, SETTINGS, LocalLimbs(model), 0), marked(forward, {0, 1}, "left_arm")
    for frame, (planes, solution) in enumerate(zip(seen, late, strict=True)):
        lag.note(Tracked(planes, (), frame / 4.9, solution, {}))
    assert lag.is_late
    assert [step.solution for step in lag.catch_up()] == late[:-3]  # more than two blocks of 0.3 seconds
    assert not lag.is_late


def test_frames_may_be_noted_while_a_block_is_settled(
    model: Model, seen: list[TriPlanes], forward: list[FrameSolution]
) -> None:
    doubtful = marked(forward, {1}, "left_arm")
    at_once, by_and_by = (FixedLag(model, SETTINGS, LocalLimbs(model), 0) for _ in range(2))
    expected = [step.solution for step in settled(at_once, seen[:7], doubtful[:7], FPS) if step.solution]
    for frame in range(7):
        by_and_by.note(Tracked(seen[frame], (), frame / FPS, doubtful[frame], {}))
    found = list[FrameSolution]()
    for step in by_and_by.settle():
        by_and_by.note(Tracked(seen[-1], (), 1.0, doubtful[-1], {}))
        found += [] if step.solution is None else [step.solution]
    assert len(found) == len(expected) == BLOCK
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
