"""The `cpu` backend with level of detail, and on several threads."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_NAMES, dofs_of, segments_below
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import count_bits
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.detail import cache
from services.mocap.energy.detail.cache import cache_folder, levels_of
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Floats

RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]
Point = tuple[float, float, float]
ALL, EVERY_DOF = tuple(range(len(SEGMENT_NAMES))), tuple(range(N_DOF))
ARM, ARM_DOFS = segments_below("left_shoulder"), dofs_of("left_shoulder", "left_elbow")
BODY_WITHOUT_ARM = tuple(s for s in ALL if s not in ARM)


@pytest.fixture(scope="module")
def backend(real_body: Body, ring: Ring) -> CpuBackend:
    return CpuBackend(real_body, ring(4))


def test_hardly_any_error_allowed_is_the_full_mesh(
    backend: CpuBackend, ring: Ring, random_poses: RandomPoses
) -> None:
    poses, region = random_poses(3, 1), Region.whole(ring(4))
    full = backend.coverage(poses, ALL, region)
    np.testing.assert_array_equal(backend.coverage(poses, ALL, region, 1e-6), full)


def test_silhouettes_change_little_and_less_the_less_is_allowed(
    backend: CpuBackend, ring: Ring, random_poses: RandomPoses
) -> None:
    """In pictures this small a contour of half a pixel's width is some ten percent of a silhouette."""
    poses, region = random_poses(60, 2), Region.whole(ring(4))
    full = backend.coverage(poses, ALL, region)
    shares = [
        count_bits(backend.coverage(poses, ALL, region, detail_px) ^ full) / count_bits(full)
        for detail_px in (0.15, 0.25, 0.5, 1.0)
    ]
    assert shares == sorted(shares)
    assert 0 < shares[0] < 0.015
    assert shares[2] < 0.04


@pytest.mark.parametrize(("eye_m", "n_poses"), [((4.0, 0.4, 1.4), 40), ((1.3, -1.0, 1.0), 30)])
def test_silhouettes_are_off_by_no_more_than_allowed(
    real_body: Body, look: Callable[..., Camera], random_poses: RandomPoses, eye_m: Point, n_poses: int
) -> None:
    """From far and from near: every pixel of either silhouette has one of the other so close by.

    Four pixels are allowed, in large pictures, beside which what sampling at pixel centres adds is small.
    Near the picture's edge the other may lie outside.
    """
    rig, allowed_px = Rig.of((look(eye_m, focal_px=700.0, width_px=640, height_px=480),)), 4.0
    poses, region, backend = random_poses(n_poses, 7), Region.whole(rig), CpuBackend(real_body, rig)
    farthest_px, inside = [], np.zeros(rig.shape_px, bool)
    inside[5:-5, 5:-5] = True
    for pose in poses:
        full, thinned = (backend.coverage(pose[None], ALL, region, px)[0, 0] > 0 for px in (0.0, allowed_px))
        if full.any() and thinned.any():
            ways = (full, thinned), (thinned, full)
            away_px = [(distance_transform_edt(~b) * (a & inside)).max() for a, b in ways]
            farthest_px.append(max(away_px))
    assert len(farthest_px) > 0.8 * n_poses
    assert max(farthest_px) <= allowed_px + 1.0
    assert max(farthest_px) > 0.3 * allowed_px  # the allowance is made use of


@pytest.mark.parametrize("halved", [False, True])
def test_energies_are_those_of_the_covered_pixels(
    backend: CpuBackend, ring: Ring, random_poses: RandomPoses, halved: bool
) -> None:
    poses, rig = random_poses(5, 3), ring(4)
    picture = Picture.whole(rig, backend.coverage(poses[:1], ALL, Region.whole(rig))[0])
    picture = picture.halved() if halved else picture
    energies = backend.energy(Problem(poses[0], EVERY_DOF, ALL, picture, detail_px=0.5))(poses)
    model = backend.coverage(poses, ALL, picture.region, 0.5)
    differs = (model ^ picture.silhouettes) & ~picture.ignored
    np.testing.assert_array_equal(energies, [count_bits(planes) for planes in differs])


def test_pre_rendering_changes_energies_by_a_constant(
    backend: CpuBackend, ring: Ring, random_poses: RandomPoses
) -> None:
    (pose, truth), rig = random_poses(2, 4), ring(4)
    picture = Picture.whole(rig, backend.coverage(truth[None], ALL, Region.whole(rig))[0])
    values = pose[list(ARM_DOFS)] + np.random.default_rng(0).normal(0, 0.3, (30, len(ARM_DOFS)))
    rest = backend.coverage(pose[None], BODY_WITHOUT_ARM, picture.region, 0.5)[0]
    drawn = backend.energy(Problem(pose, ARM_DOFS, ALL, picture, detail_px=0.5))(values)
    ignored = backend.energy(Problem(pose, ARM_DOFS, ARM, picture.ignoring(rest), detail_px=0.5))(values)
    assert np.ptp(drawn) > 0
    assert np.ptp(drawn - ignored) == 0


@pytest.mark.parametrize("detail_px", [0.0, 0.5])
@pytest.mark.parametrize("n_poses", [1, 2, 3, 50])
def test_threads_change_nothing(
    real_body: Body,
    backend: CpuBackend,
    ring: Ring,
    random_poses: RandomPoses,
    detail_px: float,
    n_poses: int,
) -> None:
    poses, rig = random_poses(n_poses, 5), ring(4)
    picture = Picture.whole(rig, backend.coverage(poses[:1], ALL, Region.whole(rig))[0])
    problem = Problem(poses[0], EVERY_DOF, ALL, picture, detail_px=detail_px)
    spread = CpuBackend(real_body, rig, threads=3)
    np.testing.assert_array_equal(spread.energy(problem)(poses), backend.energy(problem)(poses))
    spread.close()


def test_levels_are_kept_and_read_again(
    coarse_body: Body, real_body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XORMOCAP_CACHE", str(tmp_path / "kept"))
    made = levels_of(real_body)
    (kept,) = cache_folder().glob("*.npz")
    with monkeypatch.context() as context:
        context.setattr(cache, "thinned_levels", None)  # not called
        read = levels_of(real_body)
    for ladder, again in zip(made, read, strict=True):
        for level, same in zip(ladder, again, strict=True):
            assert level.error_m == same.error_m
            np.testing.assert_array_equal(level.vertices_m, same.vertices_m)
            np.testing.assert_array_equal(level.faces, same.faces)
            assert level.faces.dtype == same.faces.dtype
    levels_of(coarse_body)
    assert len(list(cache_folder().glob("*.npz"))) == 2
    for torn in (kept.read_bytes()[:1000], b"", b"PK", kept.read_bytes()[:-200]):
        kept.write_bytes(torn)
        assert [len(ladder) for ladder in levels_of(real_body)] == [len(ladder) for ladder in made]


def test_only_the_bodies_used_last_are_kept(
    coarse_body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XORMOCAP_CACHE", str(tmp_path))
    for k in range(70):
        (tmp_path / f"levels-{k}.npz").write_bytes(b"")
    levels_of(coarse_body)
    assert len(list(tmp_path.glob("levels-*.npz"))) == 64


def test_a_folder_that_cannot_be_written_to_is_no_hindrance(
    coarse_body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XORMOCAP_CACHE", str(tmp_path / "file" / "below"))
    assert len(levels_of(coarse_body)) == len(coarse_body.surfaces)


def test_a_user_without_a_home_gets_a_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless(_: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XORMOCAP_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "expanduser", homeless)
    assert cache_folder().is_absolute()


def test_segments_may_have_different_numbers_of_levels(
    real_body: Body, ring: Ring, random_poses: RandomPoses, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A segment without a coarse level is drawn from its last one, one without any from its own mesh."""
    poses, region = random_poses(4, 6), Region.whole(ring(4))
    ladders = levels_of(real_body)
    fewer = [ladder[: s % 5] for s, ladder in enumerate(ladders)]
    monkeypatch.setattr("services.mocap.energy.cpu.outline.levels_of", lambda _: fewer)
    backend = CpuBackend(replace(real_body), ring(4))  # of another body the mesh may have been made before
    full = backend.coverage(poses, ALL, region)
    for s, ladder in enumerate(fewer):
        own = replace(
            real_body,
            vertices_m=tuple(
                m if k != s or not ladder else ladder[-1].vertices_m
                for k, m in enumerate(real_body.vertices_m)
            ),
            faces=tuple(
                f if k != s or not ladder else ladder[-1].faces for k, f in enumerate(real_body.faces)
            ),
        )
        expected = CpuBackend(own, ring(4)).coverage(poses, (s,), region)
        np.testing.assert_array_equal(backend.coverage(poses, (s,), region, 100.0), expected)
    assert np.any(backend.coverage(poses, ALL, region, 100.0) != full)
