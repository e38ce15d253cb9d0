"""Fitting the actor of a take: to which frames and cameras, and from which poses. The fitting is replaced."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from exact_take import write_exact_take
from replaced_fit import QUICK, TALLER_M, fit_by, stretch
from services.mocap.body.actor import Actor
from services.mocap.body.skeleton import BodyName, pose_of_body
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, pack, trimap_of, unpack
from services.mocap.errors import TakeError
from services.mocap.fit.fitting import Fit
from services.mocap.search.first_pose import FirstPose
from services.mocap.search.found import FrameSolution
from services.mocap.search.settings import SearchSettings
from services.mocap.take.fit_record import read_record
from services.mocap.take.folder import Take, open_take
from services.mocap.take.tables import read_poses_csv
from services.mocap.types import Floats, Mask
from services.runs import fit_frames as fit_module
from services.runs.fit import DEFAULT_INIT_FRAMES, ROUGH_INIT_FRAMES, init_frames
from services.runs.fit_files import write_fit
from services.runs.take_fit import TakeFit, concluded
from services.runs.take_silhouettes import seen_of
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import Moment, Segmenter


def test_the_first_frames_are_those_of_take_toml_or_as_asked(walk: Path) -> None:
    take = open_take(walk)
    assert init_frames(take) == range(3)
    assert init_frames(take, 2) == range(2)
    longer = take.settings.model_copy(update={"init_frames": None, "frames": 40})
    untold = Take(walk, longer, take.cameras, take.source)
    assert init_frames(untold) == range(DEFAULT_INIT_FRAMES)
    assert init_frames(untold, is_refined_next=True) == range(ROUGH_INIT_FRAMES)
    told = Take(walk, take.settings.model_copy(update={"init_frames": 1}), take.cameras, take.source)
    assert init_frames(told) == init_frames(told, is_refined_next=True) == range(1)
    assert init_frames(told, 2) == range(2)


def test_the_fit_starts_near_the_actor(walk_fit: TakeFit) -> None:
    assert walk_fit.start == Actor(height=1.75)  # take.toml says so
    assert walk_fit.fit.before.iou.mean() > 0.85
    assert walk_fit.actor.height == 1.7654


def test_warnings_are_kept_for_the_user(walk_fit: TakeFit) -> None:
    assert "something odd about cam01" in walk_fit.warnings


def test_parts_that_cannot_be_told_from_the_background_are_warned_of(
    walk_fit: TakeFit, caplog: pytest.LogCaptureFixture
) -> None:
    start = (walk_fit.start, walk_fit.start_pose)
    concluded(walk_fit.frames, walk_fit.cameras, walk_fit.seen, start, walk_fit.fit, {}, [])
    assert "told from the background" not in caplog.text
    masks = np.array([unpack(planes, 3) for planes in walk_fit.seen.silhouettes])
    unsure = np.zeros_like(masks)
    rows = np.flatnonzero(masks[:, 1].any(axis=(0, 2)))
    unsure[:, 1, rows[0] + len(rows) // 2 :] = True
    hidden = np.array([pack(of_frame) for of_frame in unsure])
    seen = TriPlanes(walk_fit.seen.silhouettes & ~hidden, hidden)
    concluded(walk_fit.frames, walk_fit.cameras, seen, start, walk_fit.fit, {}, [])
    said = r"silhouettes: .* in the 3 frames of the fit \(.*legs in cam02\): .*; its overlay\.png shows where"
    assert re.search(said, caplog.text)


@pytest.fixture
def masks(monkeypatch: pytest.MonkeyPatch) -> dict[str, Mask]:
    """Camera -> the silhouette (H, W) that is seen in all frames in place of the one in its video."""
    shown: dict[str, Mask] = {}

    def segmenter(take: Take, cameras: Sequence[Camera], name: str, *options: Any) -> Segmenter:
        real = make_segmenter(take, cameras, name, *options)
        monkeypatch.setattr(real, "moments", partial(changed, real.moments, cameras))
        return real

    def changed(
        made: Callable[..., Iterator[Moment]],
        cameras: Sequence[Camera],
        start: int,
        stop: int,
        **options: bool,
    ) -> Iterator[Moment]:
        for moment in made(start, stop, **options):
            trimaps = [
                trimap_of(shown[camera.name]) if camera.name in shown else trimap
                for camera, trimap in zip(cameras, moment.trimaps, strict=True)
            ]
            yield replace(moment, trimaps=trimaps)

    monkeypatch.setattr("services.runs.take_silhouettes.make_segmenter", segmenter)
    return shown


def test_nobody_in_the_picture_is_said(walk: Path, masks: dict[str, Mask]) -> None:
    take = open_take(walk)
    for camera in take.cameras:
        masks[camera.name] = np.zeros(camera.shape_px, bool)
    with pytest.raises(TakeError, match="nobody"):
        fit_by(stretch, take, range(3))


@pytest.mark.parametrize("value", [False, True], ids=["empty", "white"])
def test_a_camera_that_makes_no_sense_is_left_out(
    walk: Path, masks: dict[str, Mask], value: bool, tmp_path: Path
) -> None:
    take = open_take(walk)
    odd = take.cameras[1]
    masks[odd.name] = np.full(odd.shape_px, value)
    found = fit_by(stretch, take, range(3))
    assert [camera.name for camera in found.cameras] == ["cam01", "cam03"]
    assert any(odd.name in sentence for sentence in found.warnings)
    assert found.fit.before.iou.mean() > 0.85
    write_fit(take, found, tmp_path)
    record = read_record(tmp_path)
    assert record is not None
    assert record.iou_after.keys() == {"cam01", "cam03"}


def test_the_body_of_the_search_is_fitted(walk: Path) -> None:
    fitted: list[BodyName] = []

    def fitter(*arguments: Any) -> Fit:
        *given, body, height_m = arguments
        fitted.append(body)
        return stretch(*given, QUICK.body, height_m)

    take, search = open_take(walk), QUICK.model_copy(update={"body": "paper"})
    found = fit_by(fitter, take, init_frames(take), search)
    assert fitted == ["paper", "paper"]
    np.testing.assert_array_equal(found.start_pose, pose_of_body(found.start_pose, "paper"))


@pytest.fixture(scope="module")
def untold(tmp_path_factory: pytest.TempPathFactory) -> Take:
    """A take whose first pose is not said, of an actor who walks from its third frame on."""
    folder = tmp_path_factory.mktemp("untold") / "walk"
    write_exact_take(folder, n_frames=12, n_cameras=3, fps=3)
    return open_take(folder)


@pytest.fixture
def found_at_once(untold: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of the search for a first pose, which takes seconds: the true one of the first frame."""
    pose = read_poses_csv(untold.folder / "reference" / "poses.csv").poses[0]
    first = FirstPose(FrameSolution(pose, energy_px=0.0))
    monkeypatch.setattr("services.mocap.search.first_frame.find_first_pose", lambda *_: first)


@pytest.mark.usefixtures("found_at_once")
@pytest.mark.parametrize("moved", [0.01, 0.2])
def test_the_fit_begins_again_from_where_the_fitted_body_is_found(
    moved: float, untold: Take, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[Floats] = []

    def fitter(rig: Rig, seen: TriPlanes, actor: Actor, pose: Floats, *others: Any) -> Fit:
        begun.append(pose)
        return stretch(rig, seen, actor, pose, *others)

    def found_again(_rig: Rig, _seen: TriPlanes, actor: Actor, pose: Floats, *, search: object) -> Floats:
        assert actor.height == TALLER_M
        assert isinstance(search, SearchSettings)
        return np.asarray(pose + moved)

    monkeypatch.setattr(fit_module, "_found_again", found_again)
    fit_by(fitter, untold, range(3))
    assert len(begun) >= 2
    assert any(np.array_equal(begun[-1], pose + moved) for pose in begun[:-1])

    alone = begun.copy()
    begun.clear()
    fit_by(fitter, untold, range(3), is_refined_next=True)
    expected = alone if moved > 0.1 else alone[:-1]
    assert len(begun) == len(expected), "near it, a fit that is refined later does not begin again"
    np.testing.assert_array_equal(begun, expected)


@pytest.mark.usefixtures("found_at_once")
@pytest.mark.parametrize(("later_iou", "chosen"), [(0.9, range(3, 6)), (0.74, range(3))])
def test_where_the_first_pose_is_not_found_the_fit_is_to_later_frames(
    untold: Take, monkeypatch: pytest.MonkeyPatch, later_iou: float, chosen: range
) -> None:
    monkeypatch.setattr(fit_module, "_found_again", lambda _rig, _seen, _actor, pose, **_: pose)
    made = make_segmenter(untold, untold.cameras)
    (_, first), (_, second) = (seen_of(untold, range(at, at + 3), made, lambda _: None) for at in (0, 3))

    def fitter(rig: Rig, seen: TriPlanes, *others: Any) -> Fit:
        iou = 0.7
        if not np.array_equal(seen.silhouettes, first.silhouettes):
            iou = later_iou - 0.01 * (not np.array_equal(seen.silhouettes, second.silhouettes))
        fit = stretch(rig, seen, *others)
        return replace(fit, after=replace(fit.after, iou=np.full_like(fit.after.iou, iou)))

    found = fit_by(fitter, untold, range(3))
    assert found.frames == chosen
    assert found.iou == pytest.approx(later_iou if chosen.start else 0.7)
    is_said = any("fitted to frames 3 to 5, because in frames 0 to 2" in said for said in found.warnings)
    assert is_said == bool(chosen.start)
