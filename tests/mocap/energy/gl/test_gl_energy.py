"""The `gl` backend's energies are the `cpu` backend's, for every cost and however batches are cut."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_NAMES, dofs_of, segments_below
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.cost import Cost
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.gl import drawing
from services.mocap.energy.gl.backend import GlBackend
from services.mocap.energy.picture import Picture
from services.mocap.types import Floats

ALL = tuple(range(len(SEGMENT_NAMES)))
EVERY_DOF = tuple(range(N_DOF))
ARM = segments_below("left_shoulder")
ARM_DOFS = dofs_of("left_shoulder", "left_elbow")
Both = Callable[[Body, Rig], tuple[GlBackend, CpuBackend]]
RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]


def noisy_picture(rig: Rig, seed: int) -> Picture:
    """Silhouettes and ignored pixels that are nothing but noise."""
    rng = np.random.default_rng(seed)
    shape = (-(-rig.n_cameras // 8), *rig.shape_px)
    existing = np.array([(1 << min(8, rig.n_cameras - 8 * p)) - 1 for p in range(shape[0])], np.uint8)
    silhouettes, ignored = rng.integers(0, 256, (2, *shape), np.uint8) & existing[:, None, None]
    return Picture.whole(rig, silhouettes).ignoring(ignored)


def unsure_picture(rig: Rig, seed: int) -> Picture:
    """The same of which as many pixels are unsure."""
    noisy, other = noisy_picture(rig, seed), noisy_picture(rig, seed + 1)
    return Picture.whole(rig, noisy.silhouettes, other.silhouettes)


def same_energies(
    backends: tuple[GlBackend, CpuBackend], problem: Problem, values: Floats, rtol: float = 0.0
) -> Floats:
    """The energies that both backends find."""
    gl, cpu = (backend.energy(problem)(values) for backend in backends)
    assert gl.dtype == np.float64
    np.testing.assert_allclose(gl, cpu, rtol=rtol, atol=0.0)
    return gl


@pytest.mark.parametrize("cut", ["whole", "window", "half"])
def test_unsure_pixels(both: Both, real_body: Body, ring: Ring, random_poses: RandomPoses, cut: str) -> None:
    rig, poses = ring(3), random_poses(4, 1)
    whole = unsure_picture(rig, 2)
    picture = whole.halved() if cut == "half" else whole
    if cut == "window":
        picture = picture.window(np.array([[10, 5], [-20, 30], [60, -7]], np.int32), 45, 40)
    problem = Problem(poses[0], EVERY_DOF, ALL, picture)
    assert len(np.unique(same_energies(both(real_body, rig), problem, poses))) > 1


@pytest.mark.parametrize("n_cameras", [1, 8, 9, 16])
def test_plain_energies(
    both: Both, real_body: Body, ring: Ring, random_poses: RandomPoses, n_cameras: int
) -> None:
    rig, poses = ring(n_cameras), random_poses(12, 1)
    energies = same_energies(
        both(real_body, rig), Problem(poses[0], EVERY_DOF, ALL, noisy_picture(rig, 2)), poses
    )
    assert len(np.unique(energies)) > 1


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    origins_px=st.lists(st.integers(-90, 110), min_size=6, max_size=6),
    width_px=st.integers(1, 70),
    height_px=st.integers(1, 70),
    halved=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_any_window_of_a_limb(
    both: Both,
    coarse_body: Body,
    ring: Ring,
    random_poses: RandomPoses,
    origins_px: list[int],
    width_px: int,
    height_px: int,
    halved: bool,
    seed: int,
) -> None:
    rig, poses = ring(3), random_poses(6, seed)
    whole = noisy_picture(rig, seed)
    picture = (whole.halved() if halved else whole).window(
        np.array(origins_px, np.int32).reshape(3, 2), width_px, height_px
    )
    same_energies(both(coarse_body, rig), Problem(poses[0], ARM_DOFS, ARM, picture), poses[:, ARM_DOFS])


@pytest.mark.parametrize(
    ("weights", "rtol"),
    [
        pytest.param((1.0, 0.5, 0.0, 2.0), 0.0, id="halves"),
        pytest.param((0.3, 0.5, 1.7, 2.0), 1e-14, id="others"),  # sums of floats, in another order
    ],
)
def test_camera_weights(
    both: Both,
    real_body: Body,
    ring: Ring,
    random_poses: RandomPoses,
    weights: tuple[float, ...],
    rtol: float,
) -> None:
    rig, poses = ring(4), random_poses(10, 3)
    backends = both(real_body, rig)
    truth = backends[1].coverage(poses[:1], ALL, noisy_picture(rig, 0).region)[0]
    problem = Problem(poses[0], EVERY_DOF, ALL, Picture.whole(rig, truth), Cost(camera_weights=weights))
    assert len(np.unique(same_energies(backends, problem, poses, rtol))) == 10


@pytest.mark.parametrize("price", [20_000_000, -20_000_000])
def test_sums_beyond_32_bits(
    both: Both,
    coarse_body: Body,
    ring: Ring,
    random_poses: RandomPoses,
    monkeypatch: pytest.MonkeyPatch,
    price: int,
) -> None:
    rig, poses = ring(2), random_poses(6, 4)
    picture = noisy_picture(rig, 11)
    tally = Cost().tally(picture)
    dear = replace(tally, gain=np.full_like(tally.gain, price))
    monkeypatch.setattr(Cost, "tally", lambda *_: dear)
    energies = same_energies(both(coarse_body, rig), Problem(poses[0], EVERY_DOF, ALL, picture), poses)
    assert np.all(np.abs(energies) > 2**32)


def test_a_batch_equals_its_poses_one_by_one(
    both: Both, real_body: Body, ring: Ring, random_poses: RandomPoses, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, poses = ring(3), random_poses(20, 6)
    gl, _ = both(real_body, rig)
    energy = gl.energy(Problem(poses[0], EVERY_DOF, ALL, noisy_picture(rig, 5)))
    together = energy(poses)
    np.testing.assert_array_equal(together, [energy(pose[None])[0] for pose in poses])
    np.testing.assert_array_equal(together[::-1], energy(poses[::-1]))
    assert energy(poses[:0]).shape == (0,)
    monkeypatch.setattr(drawing, "_PART_IMAGES", 7)
    np.testing.assert_array_equal(energy(poses), together)
