"""The paper's passes over a frame: lower energy, never worse than the best start, limits, what pools see."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import DOF_INDEX, LOWER, UPPER
from services.mocap.energy.backend import Problem
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import ALL_SURFACES, LIMBS, window_origins_px
from services.mocap.search.descent import Solution
from services.mocap.search.frame import extrapolated, solve_frame
from services.mocap.search.jobs import LimbJob, LocalLimbs, limb_jobs
from services.mocap.search.limb import solve_limb
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.take.marks import LimbName
from services.mocap.types import Bytes, Floats

Poser = Callable[..., Floats]
PictureOf = Callable[[Floats], Picture]
Errors = Callable[[Floats, Floats], Floats]
PAPER = SearchSettings(method="paper")
QUICK = SearchSettings(
    method="paper", arm_grid=(3, 3, 1, 3), leg_grid=(3, 1, 1, 3), descent_rounds=1, detail_px=0
)


class Pool:
    """Solves limbs with a function, the last job first, and remembers the jobs."""

    def __init__(self, solve: Callable[[LimbJob], Solution]) -> None:
        self._solve = solve
        self.passes: list[list[LimbJob]] = []

    def start(self, jobs: list[LimbJob]) -> None:
        self.passes.append(jobs)

    def finish(self) -> Iterable[tuple[LimbName, Solution]]:
        return [(job.limb, self._solve(job)) for job in reversed(self.passes[-1])]


def pool_of(model: Model) -> Pool:
    """Limbs as LocalLimbs solves them, all with this model's own backend, which counts evaluations."""
    return Pool(lambda job: solve_limb(model, job.limb, job.window, job.pose, job.settings))


def sabotage(job: LimbJob) -> Solution:
    """A limb at its upper limits, far from anywhere."""
    dofs = LIMBS[job.limb].dofs
    return Solution(dofs, UPPER[list(dofs)], 0.0, 1)


def whole_energy_px(model: Model, picture: Picture, pose: Floats) -> float:
    """Plain XOR of the full mesh."""
    energy = model.backend.energy(Problem(pose, tuple(range(N_DOF)), ALL_SURFACES, picture))
    return float(energy(pose[None])[0])


def disturbed(pose: Floats, seed: int) -> Floats:
    """A pose up to 3 cm and 0.1 rad off in every parameter."""
    by = np.where(np.arange(N_DOF) < 3, 0.03, 0.1)
    return clip_to_limits(pose + by * np.random.default_rng(seed).uniform(-1, 1, N_DOF))


@pytest.fixture
def truth(standing: Poser) -> Floats:
    return standing(
        shoulder_elevation=-50, elbow_flexion=30, hip_flexion=15, knee_flexion=20, root_heading=25
    )


@pytest.mark.parametrize("seed", range(2))
def test_a_disturbed_body_is_found_again(
    model: Model, truth: Floats, picture_of: PictureOf, joint_errors_mm: Errors, seed: int
) -> None:
    start, picture = disturbed(truth, seed), picture_of(truth)
    backend: Any = model.backend
    before = backend.evaluations
    found = solve_frame(model, picture, start[None], PAPER, pool_of(model))
    assert found.evaluations == backend.evaluations - before
    assert joint_errors_mm(start, truth).mean() > 50
    assert joint_errors_mm(found.pose, truth).mean() < 30
    assert found.energy_px == whole_energy_px(model, picture, found.pose)
    assert found.energy_px < 0.2 * whole_energy_px(model, picture, start)
    assert np.all((found.pose >= LOWER) & (found.pose <= UPPER))
    assert 1 <= found.passes <= PAPER.max_passes
    assert found.seconds.keys() == {"torso", "head", "limbs"}
    assert min(found.seconds.values()) > 0.0


def test_never_worse_than_the_best_start(model: Model, truth: Floats, picture_of: PictureOf) -> None:
    picture = picture_of(truth)
    starts = np.stack([disturbed(truth, 4), truth, disturbed(truth, 5)])
    untouched = starts.copy()
    found = solve_frame(model, picture, starts, QUICK, Pool(sabotage))
    assert found.energy_px == 0.0
    assert_array_equal(found.pose, truth)
    assert_array_equal(starts, untouched)


def test_the_search_begins_at_the_best_start(model: Model, truth: Floats, picture_of: PictureOf) -> None:
    starts = np.stack([disturbed(truth, 4) + np.eye(N_DOF)[0], truth])
    pool = pool_of(model)
    solve_frame(model, picture_of(truth), starts, QUICK, pool)
    np.testing.assert_allclose(pool.passes[0][0].pose[:6], truth[:6], atol=0.05)


def test_a_start_beyond_the_limits_is_moved_within(
    model: Model, standing: Poser, picture_of: PictureOf
) -> None:
    truth, bent = (
        standing(shoulder_elevation=-60),
        [DOF_INDEX["left_knee_flexion"], DOF_INDEX["right_elbow_flexion"]],
    )
    truth[bent] = LOWER[bent]
    beyond = truth.copy()
    beyond[bent] -= 0.02
    found = solve_frame(model, picture_of(truth), beyond[None], QUICK, Pool(sabotage))
    assert np.all((found.pose >= LOWER) & (found.pose <= UPPER))
    assert found.energy_px == 0.0


@pytest.mark.parametrize("seed", range(2))
def test_thinned_meshes_lead_to_nearly_the_same_pose(
    model: Model, truth: Floats, picture_of: PictureOf, joint_errors_mm: Errors, seed: int
) -> None:
    start, picture = disturbed(truth, seed)[None], picture_of(truth)
    thinned, full = (
        solve_frame(
            model, picture, start, PAPER.model_copy(update={"detail_px": detail_px}), LocalLimbs(model)
        )
        for detail_px in (0.5, 0.0)
    )
    assert not np.array_equal(thinned.pose, full.pose)
    assert joint_errors_mm(thinned.pose, full.pose).mean() < 10
    assert thinned.energy_px == whole_energy_px(model, picture, thinned.pose)
    assert full.energy_px == whole_energy_px(model, picture, full.pose)


@pytest.mark.parametrize(
    "changed",
    [{}, {"detail_px": 2.0}, {"camera_weights": (2.0,) + (1.0,) * 7}],
    ids=str,
)
def test_plain_xor_of_the_full_mesh_is_reported_whatever_was_minimised(
    model: Model, truth: Floats, picture_of: PictureOf, changed: dict[str, Any]
) -> None:
    search, picture = QUICK.model_copy(update={"max_passes": 1, **changed}), picture_of(truth)
    backend: Any = model.backend
    before = backend.evaluations
    found = solve_frame(model, picture, disturbed(truth, 3)[None], search, pool_of(model))
    assert found.evaluations == backend.evaluations - before
    assert found.energy_px == whole_energy_px(model, picture, found.pose)


def test_starts_and_passes_are_compared_by_the_cost_of_the_search(
    model: Model, truth: Floats, silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    """The first camera shows another pose than the others, and is the only one that counts."""
    other = disturbed(truth, 4)
    silhouettes = silhouettes_of(truth) & 1 | silhouettes_of(other) & ~np.uint8(1)
    picture = Picture.whole(model.rig, silhouettes)
    search = QUICK.model_copy(update={"camera_weights": (1.0,) + (0.0,) * 7})
    found = solve_frame(model, picture, np.stack([other, truth]), search, Pool(sabotage))
    assert_array_equal(found.pose, truth)
    assert found.energy_px == whole_energy_px(model, picture, truth)
    assert found.energy_px > whole_energy_px(model, picture, other)


def test_solutions_in_any_order_give_the_same_frame(
    model: Model, truth: Floats, picture_of: PictureOf
) -> None:
    start, picture = disturbed(truth, 6)[None], picture_of(truth)
    pool = pool_of(model)
    backwards = solve_frame(model, picture, start, QUICK, pool)
    forwards = solve_frame(model, picture, start, QUICK, LocalLimbs(model))
    assert_array_equal(backwards.pose, forwards.pose)
    assert (backwards.energy_px, backwards.evaluations) == (forwards.energy_px, forwards.evaluations)


def test_every_pass_hands_out_four_limbs(model: Model, truth: Floats, picture_of: PictureOf) -> None:
    pool = pool_of(model)
    relentless = QUICK.model_copy(update={"max_passes": 2, "pass_tolerance": 0.0})
    found = solve_frame(model, picture_of(truth), disturbed(truth, 8)[None], relentless, pool)
    assert found.passes == len(pool.passes) == 2
    for jobs in pool.passes:
        assert [job.limb for job in jobs] == list(LIMBS)
        assert all(job.settings == relentless for job in jobs)


def test_passes_end_when_nothing_more_is_gained(model: Model, truth: Floats, picture_of: PictureOf) -> None:
    settings = QUICK.model_copy(update={"max_passes": 20})
    assert solve_frame(model, picture_of(truth), truth[None], settings, LocalLimbs(model)).passes == 1


def test_jobs_carry_the_input_in_the_limbs_window(model: Model, truth: Floats, picture_of: PictureOf) -> None:
    whole = picture_of(truth)
    for job in limb_jobs(model, whole, truth, QUICK):
        origins_px = window_origins_px((LIMBS[job.limb].main,), truth, model.body, model.rig)[0]
        assert_array_equal(job.window.region.origin_px, origins_px)
        assert job.window.silhouettes.shape == (1, 128, 128)
        assert_array_equal(job.pose, truth)
        for c, (x, y) in enumerate(origins_px):
            cut = whole.silhouettes[0, y : y + 128, x : x + 128] >> c & 1
            assert_array_equal(job.window.silhouettes[0] >> c & 1, cut)


def test_extrapolation_goes_on_at_the_same_speed() -> None:
    first, second = np.zeros(N_DOF), np.linspace(0.0, 0.1, N_DOF)
    assert_array_equal(extrapolated([second]), second[None])
    assert_array_equal(extrapolated([first, second]), np.stack([second, 2 * second, 1.5 * second]))
