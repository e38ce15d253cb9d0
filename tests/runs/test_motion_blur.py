"""Motion blur is told from silhouettes that reach too far where the actor is fast, and cut off."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.fit.contours import Contour
from services.mocap.synth.motions import make_motion
from services.mocap.take.tables import PoseTable
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Mask, Trimap
from services.runs.motion_blur import MovingOutline, blur_of, cut_motion_blur, without_smear
from services.segmentation.kept_trimaps import KeptTrimaps
from services.segmentation.silhouettes import Segmenter, VideoSilhouettes

_EXPOSURE = 0.375
"""Of a frame, as with a shutter of 1/40 s at 15 frames a second."""
_LEAST_SHARE = 0.25
_ACTOR = Actor(height=1.75)


@pytest.fixture
def cameras(small_cameras: Callable[[int], list[Camera]]) -> list[Camera]:
    return [camera.resized(320, 240) for camera in small_cameras(4)]


@pytest.fixture(scope="module")
def dance() -> PoseTable:
    """Frames of a dance, with arms at up to 5 m/s."""
    poses = make_motion("dance", 90, 15.0, build_body(_ACTOR), seed=0).poses[50:90]
    frames = np.arange(len(poses), dtype=np.int32)
    return PoseTable(frames, frames / 15.0, poses, np.zeros(len(poses)))


def _seen(dance: PoseTable, rig: Rig, exposure: float) -> Iterator[Mask]:
    """Frame by frame (C, H, W) what the body covers for a quarter of the time that the shutter is open."""
    rows, backend = np.arange(len(dance.frames)), CpuBackend(build_body(_ACTOR), rig)
    for row in rows:
        moments = np.clip(row + exposure * np.linspace(-0.5, 0.5, 9), 0, rows[-1])
        poses = np.array([np.interp(moments, rows, of_dof) for of_dof in dance.poses.T]).T
        planes = backend.coverage(poses, tuple(range(len(SEGMENT_NAMES))), Region.whole(rig))
        shares = np.mean([unpack(of_moment, rig.n_cameras) for of_moment in planes], axis=0)
        yield shares > _LEAST_SHARE
    backend.close()


def _kept(folder: Path, cameras: list[Camera], seen: Iterator[Mask]) -> tuple[Segmenter, KeptTrimaps]:
    """Kept silhouettes, and a segmenter that makes no others."""
    kept = KeptTrimaps(folder, cameras)
    for frame, masks in enumerate(seen):
        kept.keep(frame, list(masks * np.uint8(ACTOR)))
    no_others = Mock(side_effect=AssertionError("they are kept"))
    return Segmenter(cameras, VideoSilhouettes(Mock(), cameras, no_others, kept)), kept


def _shares_off(kept: KeptTrimaps, exact: list[Mask]) -> float:
    """The pixels that differ, as a share of those that the actor covers while the arms are fast."""
    found = [np.array(kept.read(frame)) == ACTOR for frame in range(len(exact))]
    return float(np.sum(np.array(found) != np.array(exact)) / np.sum(exact))


def test_smears_are_cut_off(tmp_path: Path, dance: PoseTable, cameras: list[Camera]) -> None:
    rig = Rig.of(cameras)
    exact = list(_seen(dance, rig, 0.0))
    segmenter, kept = _kept(tmp_path, cameras, _seen(dance, rig, _EXPOSURE))
    before = _shares_off(kept, exact)
    blur = cut_motion_blur(segmenter, kept, tuple(cameras), _ACTOR, dance)
    half_px = (0.5 - _LEAST_SHARE) * _EXPOSURE  # over the speed; from 8 px on, 4 px count for nothing
    assert half_px < blur < 2 * half_px
    assert _shares_off(kept, exact) < 0.8 * before


def test_a_pose_that_is_lost_harms_no_neighbour(
    tmp_path: Path, dance: PoseTable, cameras: list[Camera]
) -> None:
    """The body is half a metre off in two frames: those before and after are cut as if it were not."""
    rig = Rig.of(cameras)
    cuts = list[list[Trimap]]()
    for shift_m in (0.0, 0.5):
        folder = tmp_path / f"{shift_m}"
        folder.mkdir()
        segmenter, kept = _kept(folder, cameras, _seen(dance, rig, _EXPOSURE))
        poses = dance.poses.copy()
        poses[[10, 25], :2] += shift_m
        assert cut_motion_blur(segmenter, kept, tuple(cameras), _ACTOR, replace(dance, poses=poses)) > 0
        cuts.append([np.array(kept.read(frame)) for frame in (9, 11, 24, 26)])
    removed = [np.sum(was & ~now) / np.sum(was) for was, now in zip(*cuts, strict=True)]
    assert max(removed) < 0.02


def test_nothing_is_cut_beside_unsure_pixels() -> None:
    """Where the actor ends at unsure pixels no outline is known."""
    trimap = np.zeros((240, 320), np.uint8)
    trimap[50:150, 50:100], trimap[50:150, 100:130] = ACTOR, UNSURE
    contour = Contour.of(trimap == ACTOR, 1.0, 0, trimap == UNSURE)
    speeds_px = np.full(len(contour.points_px), 24.0)
    cut = without_smear(trimap, MovingOutline(contour.points_px, speeds_px, speeds_px), 0.1)
    assert np.array_equal(cut == UNSURE, trimap == UNSURE)
    assert np.all(cut[60:140, 90:100] == ACTOR)
    assert np.all(cut[60:140, 50:52] == BACKGROUND)
    assert np.all(cut[60:140, 53:100] == ACTOR)


def test_sharp_silhouettes_stay(tmp_path: Path, dance: PoseTable, cameras: list[Camera]) -> None:
    segmenter, kept = _kept(tmp_path, cameras, _seen(dance, Rig.of(cameras), 0.0))
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert cut_motion_blur(segmenter, kept, tuple(cameras), _ACTOR, dance) == 0.0
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("before_px", "behind_px", "n_points", "blur"),
    [
        (0.8, 0.8, 1000, 0.1),
        (0.8, 1.6, 1000, 0.1),
        (0.0, 1.6, 1000, 0.0),  # cloth that trails
        (0.2, 0.2, 1000, 0.0),
        (0.8, 0.8, 200, 0.0),  # too few to tell
    ],
)
def test_blur_is_alike_before_the_actor_and_behind(
    before_px: float, behind_px: float, n_points: int, blur: float
) -> None:
    """A body that is .3 px too thin all over, seen at rest and at 12 px a frame; the rest of the outline is
    unknown."""
    speeds_px, excess_px = np.array([0.0, 12.0, -12.0, np.nan]), np.array([0.0, before_px, behind_px, np.nan])
    outline = MovingOutline(
        np.zeros((4 * n_points, 2)), np.repeat(speeds_px, n_points), np.repeat(excess_px + 0.3, n_points)
    )
    assert blur_of([outline]) == pytest.approx(blur)
    assert blur_of([]) == 0.0
