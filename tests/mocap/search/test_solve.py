"""Solving one chain: limbs and head found again in the model's own silhouettes, alone and in shards."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.colours import QUARTERS, class_table
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import LOWER, UPPER
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import pack_classes
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SURFACES, HEAD, LIMBS, TORSO
from services.mocap.search.descent import Solution
from services.mocap.search.limb import solve_limb
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import descend_stage, stage_window
from services.mocap.take.marks import LimbName
from services.mocap.types import Floats

Poser = Callable[..., Floats]
PictureOf = Callable[[Floats], Picture]
Errors = Callable[[Floats, Floats], Floats]
QUICK = SearchSettings(arm_grid=(3, 3, 1, 3), leg_grid=(3, 1, 1, 3), descent_rounds=2)
PAPER = SearchSettings(method="paper")
FULL_MESH = SearchSettings(method="paper", detail_px=0)
COSTLY = SearchSettings(method="paper", detail_px=1.5, camera_weights=(2.0,) + (1.0,) * 7)


def disturbed(pose: Floats, dofs: tuple[int, ...], seed: int, by_rad: float = 0.2) -> Floats:
    """The pose with some parameters up to 0.2 rad (11 degrees) off, within the limits."""
    off = pose.copy()
    off[list(dofs)] += np.random.default_rng(seed).uniform(-by_rad, by_rad, len(dofs))
    return clip_to_limits(off)


@pytest.fixture
def truth(standing: Poser) -> Floats:
    """A pose in which arms and legs are clear of the trunk and bent."""
    return standing(
        shoulder_elevation=-50, elbow_flexion=30, hip_flexion=15, knee_flexion=20, root_heading=25
    )


def limb_window(model: Model, name: LimbName, picture: Picture, pose: Floats) -> Picture:
    return stage_window(model, LIMBS[name].main, picture, pose)


def assert_within_limits(solution: Solution) -> None:
    dofs = list(solution.dofs)
    assert np.all((solution.values >= LOWER[dofs]) & (solution.values <= UPPER[dofs]))


def limb_energy_px(
    model: Model, name: LimbName, window: Picture, pose: Floats, drawn: Floats, settings: SearchSettings
) -> float:
    """The limb's energy of a pose where everything else is pre-rendered as in the pose `drawn`."""
    stage, detail_px = LIMBS[name].main, settings.detail_px
    window = window.ignoring(model.backend.coverage(drawn[None], stage.others, window.region, detail_px)[0])
    energy = model.backend.energy(Problem(pose, stage.dofs, stage.segments, window, settings.cost, detail_px))
    return float(energy(pose[None, list(stage.dofs)])[0])


@pytest.mark.parametrize("name", LIMBS)
@pytest.mark.parametrize("seed", range(3))
def test_a_disturbed_limb_is_found_again(
    model: Model, truth: Floats, picture_of: PictureOf, joint_errors_mm: Errors, name: LimbName, seed: int
) -> None:
    start = disturbed(truth, LIMBS[name].dofs, seed)
    before_mm = joint_errors_mm(start, truth).max()
    found = solve_limb(
        model, name, limb_window(model, name, picture_of(truth), start), start, SearchSettings()
    )
    after_mm = joint_errors_mm(found.applied_to(start), truth).max()
    assert before_mm > 50
    assert after_mm < 30
    assert found.dofs == LIMBS[name].dofs
    assert_within_limits(found)


@pytest.mark.parametrize("name", LIMBS)
@pytest.mark.parametrize("search", [FULL_MESH, PAPER, COSTLY], ids=["full", "usual", "costly"])
def test_a_limb_costs_what_it_says(
    model: Model, truth: Floats, picture_of: PictureOf, name: LimbName, search: SearchSettings
) -> None:
    """By the cost and the level of detail that were asked for, in the pre-render too."""
    start = disturbed(truth, LIMBS[name].dofs, 7)
    whole = picture_of(truth)
    window = limb_window(model, name, whole, start)
    backend: Any = model.backend
    before = backend.evaluations
    found = solve_limb(model, name, window, start, search)
    assert found.evaluations == backend.evaluations - before
    # Its energy is that of the ball and hinge, with the hand or foot as in the start.
    main = Solution(LIMBS[name].main.dofs, found.values[: len(LIMBS[name].main.dofs)], 0.0, 0)
    assert found.energy_px == limb_energy_px(model, name, window, main.applied_to(start), start, search)
    whole_px = limb_energy_px(model, name, window, found.applied_to(start), start, search)
    start_px = limb_energy_px(model, name, window, start, start, search)
    assert found.energy_px < start_px
    assert whole_px < start_px


@pytest.mark.parametrize(("name", "n"), [("left_arm", 3), ("right_leg", 2)])
def test_the_best_shard_is_no_worse_than_one_worker(
    model: Model, truth: Floats, picture_of: PictureOf, name: LimbName, n: int
) -> None:
    start = disturbed(truth, LIMBS[name].dofs, 3, by_rad=0.4)
    window = limb_window(model, name, picture_of(truth), start)
    alone = solve_limb(model, name, window, start, SearchSettings())
    shards = [solve_limb(model, name, window, start, SearchSettings(), (k, n)) for k in range(n)]
    assert min(shard.energy_px for shard in shards) <= alone.energy_px
    start_px = limb_energy_px(model, name, window, start, start, SearchSettings())
    start_px += model.aligner(SearchSettings()).prices_px(start[None], SearchSettings())[0]
    assert max(shard.energy_px for shard in shards) <= start_px


def test_a_shard_without_grid_points_still_begins_at_the_start(
    model: Model, truth: Floats, picture_of: PictureOf
) -> None:
    one_point = SearchSettings(arm_grid=(1, 1, 1, 1))
    start = disturbed(truth, LIMBS["left_arm"].dofs, 1)
    window = limb_window(model, "left_arm", picture_of(truth), start)
    whole = solve_limb(model, "left_arm", window, start, one_point)
    last = solve_limb(model, "left_arm", window, start, one_point, (63, 64))
    np.testing.assert_array_equal(last.values, whole.values)
    assert last.energy_px == whole.energy_px


@given(st.integers(0, 2**32 - 1), st.sampled_from(list(LIMBS)))
@settings(max_examples=25, deadline=None)
def test_limbs_keep_to_their_limits_and_never_get_worse(
    model: Model, picture_of: PictureOf, standing: Poser, seed: int, name: LimbName
) -> None:
    """From any pose, one beyond its limits too, before silhouettes of quite another one."""
    rng = np.random.default_rng(seed)
    start, shown = standing(), standing()
    start[6:] = rng.uniform(LOWER[6:] - 0.5, UPPER[6:] + 0.5)
    shown[6:] = rng.uniform(LOWER[6:], UPPER[6:])
    window = limb_window(model, name, picture_of(shown), start)
    found = solve_limb(model, name, window, start, QUICK)
    assert_within_limits(found)
    within = clip_to_limits(start)
    prices_px = model.aligner(QUICK).prices_px(within[None], QUICK)[0]
    assert found.energy_px <= limb_energy_px(model, name, window, within, within, QUICK) + prices_px
    assert np.array_equal(np.delete(found.applied_to(start), found.dofs), np.delete(start, found.dofs))


def test_the_head_is_found_again(
    model: Model, truth: Floats, picture_of: PictureOf, joint_errors_mm: Errors
) -> None:
    start = disturbed(truth, HEAD.dofs, 5, by_rad=0.4)
    found = descend_stage(model, HEAD, picture_of(truth), start, SearchSettings())
    assert joint_errors_mm(start, truth).max() > 25
    assert joint_errors_mm(found.applied_to(start), truth).max() < 10
    assert_within_limits(found)


def test_the_torso_is_found_again(
    model: Model, truth: Floats, picture_of: PictureOf, joint_errors_mm: Errors
) -> None:
    start = disturbed(truth, TORSO.dofs[3:], 2, by_rad=0.1)
    start[:3] += 0.04, -0.05, 0.03
    backend: Any = model.backend
    before = backend.evaluations
    found = descend_stage(model, TORSO, picture_of(truth).halved(), start, SearchSettings())
    assert found.evaluations == backend.evaluations - before
    assert joint_errors_mm(start, truth).mean() > 70
    assert joint_errors_mm(found.applied_to(start), truth).mean() < 15


def test_from_the_truth_nothing_gets_worse(
    model: Model, truth: Floats, picture_of: PictureOf, joint_errors_mm: Errors
) -> None:
    picture = picture_of(truth)
    energy = model.backend.energy(Problem(truth, tuple(range(N_DOF)), ALL_SURFACES, picture))
    assert energy(truth[None])[0] == 0.0
    for name in LIMBS:
        found = solve_limb(model, name, limb_window(model, name, picture, truth), truth, FULL_MESH)
        assert found.energy_px == 0.0
        # Where counted pixels do not tell poses apart, a line search may go a little way.
        assert joint_errors_mm(found.applied_to(truth), truth).max() < 3.0
        np.testing.assert_allclose(found.applied_to(truth), truth, atol=0.05)


def test_applying_a_solution_copies_the_pose(truth: Floats) -> None:
    before = truth.copy()
    changed = Solution((6, 8), np.array([0.1, 0.2]), 5.0, 1).applied_to(truth)
    np.testing.assert_array_equal(truth, before)
    assert (changed[6], changed[8]) == (0.1, 0.2)
    np.testing.assert_array_equal(np.delete(changed, (6, 8)), np.delete(truth, (6, 8)))


def test_a_limb_before_the_trunk_is_found_by_its_colour(
    model: Model, standing: Poser, picture_of: PictureOf, joint_errors_mm: Errors
) -> None:
    """Where it is in front of the trunk in most pictures, no contour says where."""
    sleeves = {f"left_{name}": (2,) * QUARTERS for name in ("upper_arm", "forearm", "hand")}
    trunk = dict.fromkeys(("torso", "pelvis"), (1,) * QUARTERS)
    body, truth = replace(model.body, colour_classes=class_table(sleeves | trunk)), standing()
    arm = list(LIMBS["left_arm"].main.dofs)
    truth[arm] = [-2.0, -0.03, -0.63, 2.02]
    plain, whole = picture_of(truth), Region.whole(model.rig)
    coloured = Model(body, model.rig, model.backend)
    picture = replace(plain, classes=pack_classes(coloured.colours.painted(truth, whole)))
    errors_mm = []
    for seed in range(3):
        start = disturbed(truth, LIMBS["left_arm"].dofs, seed, by_rad=0.15)
        window = limb_window(coloured, "left_arm", picture, start)
        solutions = (
            solve_limb(coloured, "left_arm", window, start, SearchSettings(colour=price, pose_prior=0.0))
            for price in (0.0, 1.0)
        )
        errors_mm.append([joint_errors_mm(one.applied_to(start), truth).max() for one in solutions])
    by_outline, by_colour = np.array(errors_mm).T
    assert (by_colour < by_outline).all()
    assert by_colour.mean() < 0.85 * by_outline.mean()
