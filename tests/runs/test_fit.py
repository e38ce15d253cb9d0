"""What `xormocap fit` does, with the fitting itself replaced: what it is given, and what comes of it."""

import csv
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from exact_take import write_exact_take
from first_pose import say_first_pose
from services import cli
from services.commands import fit as fit_command
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.shape_space import vector_of
from services.mocap.body.skeleton import DOF_INDEX, BodyName, pose_of_body
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, pack, trimap_of, unpack
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import TakeError
from services.mocap.fit.fitting import Fit
from services.mocap.fit.quality import quality_of
from services.mocap.result.words import ENERGY_IN_WORDS, IOU_IN_WORDS
from services.mocap.search.first_pose import FirstPose
from services.mocap.search.found import FrameSolution
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import read_actor, take_actor, write_actor
from services.mocap.take.fit_record import OCCLUDED, fitted_pose, read_occluded, read_record
from services.mocap.take.folder import Take, open_take
from services.mocap.take.tables import read_poses_csv
from services.mocap.types import UNSURE, Floats, Mask
from services.runs import fit_frames as fit_module
from services.runs.fit import fit_take, init_frames
from services.runs.fit_files import write_fit
from services.runs.take_fit import TakeFit, concluded
from services.runs.take_silhouettes import TakeSilhouettes, seen_of
from services.runs.way_round import tracked_px
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import Moment, Segmenter

CPU, QUICK = EngineSettings(backend="cpu"), SearchSettings(max_passes=1)
TALLER_M = 1.76543219
FILES = {"actor.toml", "fit.json", "poses.csv", "measures.csv", "overlay.png", "turntable.png"}
log = logging.getLogger("services.mocap.fit")


def stretch(
    rig: Rig,
    seen: TriPlanes,
    start: Actor,
    poses: Floats,
    progress: Callable[[float], None],
    body: BodyName,
    height_m: float | None,
) -> Fit:
    """In place of the fit: another height, all frames in the first pose."""
    assert seen.silhouettes.shape == seen.unsure.shape == (3, 1, *rig.shape_px)
    log.warning("something odd about %s", "cam01")
    assert body == QUICK.body
    assert height_m in (None, start.height)
    progress(0.5)
    actor, poses = Actor(height=TALLER_M), np.tile(poses, (len(seen), 1))
    before, after = (quality_of(build_body(shape), poses, rig, seen) for shape in (start, actor))
    return Fit(actor, poses, before, after)


def fit_by(
    fitter: Callable[..., Fit],
    take: Take,
    frames: range,
    search: SearchSettings = QUICK,
    show: Callable[[str, float], None] = lambda *_: None,
    **others: bool,
) -> TakeFit:
    """As fit_take, with this in place of the fit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("services.runs.fit_frames.fit_actor", fitter)
        return fit_take(TakeSilhouettes(take), frames, CPU, search, show, **others)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take whose first pose is said, so that it is found at once."""
    folder = tmp_path_factory.mktemp("fit") / "walk"
    write_exact_take(folder, n_frames=3, n_cameras=3)
    say_first_pose(folder)
    return folder


@pytest.fixture(scope="module")
def found(folder: Path) -> TakeFit:
    shown: list[tuple[str, float]] = []
    take = open_take(folder)
    found = fit_by(stretch, take, init_frames(take), show=lambda *step: shown.append(step))
    shares = [share for _, share in shown]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] < 1.0
    return found


def test_the_first_frames_are_those_of_take_toml_or_as_asked(folder: Path) -> None:
    take = open_take(folder)
    assert init_frames(take) == range(3)
    assert init_frames(take, 2) == range(2)
    untold = Take(folder, take.settings.model_copy(update={"init_frames": None}), take.cameras, take.source)
    assert init_frames(untold, usual=2) == range(2)
    told = Take(folder, take.settings.model_copy(update={"init_frames": 1}), take.cameras, take.source)
    assert init_frames(told) == init_frames(told, usual=2) == range(1)
    assert init_frames(told, 2) == range(2)


def test_the_fit_starts_near_the_actor(found: TakeFit) -> None:
    assert found.start == Actor(height=1.75)  # take.toml says so
    assert found.fit.before.iou.mean() > 0.85
    assert found.actor.height == 1.7654


def test_tracking_on_from_the_truth_costs_less_than_from_the_opposite(folder: Path, found: TakeFit) -> None:
    take = open_take(folder)
    made = make_segmenter(take, take.cameras)
    cameras, seen = seen_of(take, range(3), made, lambda _: None)
    turned = found.fit.poses.copy()
    turned[:, DOF_INDEX["root_heading"]] += np.pi
    ways = found.fit, replace(found.fit, poses=turned)
    right_px, wrong_px = (
        tracked_px(Rig.of(cameras), [seen[f] for f in range(3)], fit, SearchSettings()) for fit in ways
    )
    assert right_px < wrong_px


def test_warnings_are_kept_for_the_user(found: TakeFit) -> None:
    assert "something odd about cam01" in found.warnings


def test_parts_that_cannot_be_told_from_the_background_are_warned_of(
    found: TakeFit, caplog: pytest.LogCaptureFixture
) -> None:
    start = (found.start, found.start_pose)
    concluded(found.frames, found.cameras, found.seen, start, found.fit, {}, [])
    assert "told from the background" not in caplog.text
    masks = np.array([unpack(planes, 3) for planes in found.seen.silhouettes])
    unsure = np.zeros_like(masks)
    rows = np.flatnonzero(masks[:, 1].any(axis=(0, 2)))
    unsure[:, 1, rows[0] + len(rows) // 2 :] = True
    hidden = np.array([pack(of_frame) for of_frame in unsure])
    seen = TriPlanes(found.seen.silhouettes & ~hidden, hidden)
    concluded(found.frames, found.cameras, seen, start, found.fit, {}, [])
    said = r"silhouettes: .* in the 3 frames of the fit \(.*legs in cam02\): .*; its overlay\.png shows where"
    assert re.search(said, caplog.text)


def test_all_files_are_written_and_belong_together(folder: Path, found: TakeFit, tmp_path: Path) -> None:
    take, out = open_take(folder), tmp_path / "out"
    for _ in range(2):  # a second fit takes the place of the first
        write_fit(take, found, out)
        assert {path.name for path in out.iterdir()} == FILES
    actor = read_actor(out / "actor.toml")
    assert actor == found.actor
    for frame in range(3):
        pose = fitted_pose(out, actor, take.settings, frame)
        assert pose is not None
        assert np.allclose(pose, found.fit.poses[frame], atol=1e-6)
    record = read_record(out)
    assert record is not None
    assert record.iou_after.keys() == {"cam01", "cam02", "cam03"}
    assert record.energy_before_px == found.fit.before.energy_px.tolist()


def test_what_hides_the_actor_is_kept_with_the_fit(folder: Path, found: TakeFit, tmp_path: Path) -> None:
    take = open_take(folder)
    camera = take.cameras[1]
    mask: Mask = np.zeros(camera.shape_px, bool)
    mask[100:140, 30:90] = True
    write_fit(take, replace(found, occluded={camera.name: mask}), tmp_path)
    occluded = read_occluded(tmp_path, take.cameras)
    assert occluded.keys() == {camera.name}
    assert np.array_equal(occluded[camera.name], mask)
    made = make_segmenter(take, take.cameras)
    plain, known = (next(iter(segmenter.trimaps(0, 1))) for segmenter in (made, made.knowing(occluded)))
    assert np.all(known[1][mask] == UNSURE)
    assert np.array_equal(known[1][~mask], plain[1][~mask])
    assert np.array_equal(known[0], plain[0])
    half = camera.reduced(camera.width_px // 2)  # the take's longest_side was changed since the fit
    of_half = read_occluded(tmp_path, [half])[camera.name]
    assert np.array_equal(of_half, mask[::2, ::2])
    with pytest.raises(TakeError, match=r"occluded.cam02\.png: has another aspect ratio than cam02"):
        read_occluded(tmp_path, [camera.resized(camera.height_px, camera.width_px)])
    path = tmp_path / OCCLUDED / f"{camera.name}.png"
    path.write_bytes(path.read_bytes()[:50])
    with pytest.raises(TakeError, match=r"occluded.cam02\.png: cannot be decoded as a picture"):
        read_occluded(tmp_path, take.cameras)
    write_fit(take, found, tmp_path)  # a fit that knows of nothing
    assert not read_occluded(tmp_path, take.cameras)


def test_measures_and_pictures_can_be_read(folder: Path, found: TakeFit, tmp_path: Path) -> None:
    write_fit(open_take(folder), found, tmp_path)
    with (tmp_path / "measures.csv").open(newline="") as file:
        rows = {row["measure"]: float(row["cm"]) for row in csv.DictReader(file)}
    assert rows["height"] == pytest.approx(176.5, abs=0.3)
    for name in ("overlay.png", "turntable.png"):
        assert cv2.imread(str(tmp_path / name)).std() > 10


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


def test_nobody_in_the_picture_is_said(folder: Path, masks: dict[str, Mask]) -> None:
    take = open_take(folder)
    for camera in take.cameras:
        masks[camera.name] = np.zeros(camera.shape_px, bool)
    with pytest.raises(TakeError, match="nobody"):
        fit_by(stretch, take, range(3))


@pytest.mark.parametrize("value", [False, True], ids=["empty", "white"])
def test_a_camera_that_makes_no_sense_is_left_out(
    folder: Path, masks: dict[str, Mask], value: bool, tmp_path: Path
) -> None:
    take = open_take(folder)
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


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, found: TakeFit) -> Callable[..., str]:
    """`command(*arguments)`: what the command prints; the fit is the one that is there already."""
    monkeypatch.setattr(fit_command, "fit_take", lambda *_, **__: found)

    def run(*arguments: object) -> str:
        done = CliRunner().invoke(cli.app, ["fit", *map(str, arguments)], catch_exceptions=True)
        return str(done.exception) if done.exception else done.output

    return run


def test_the_command_writes_into_the_take(folder: Path, found: TakeFit, command: Callable[..., str]) -> None:
    said = command(folder)
    assert take_actor(open_take(folder)) == found.actor
    assert {path.name for path in (folder / "fit").iterdir()} == FILES
    for word in ("height", "arm span", "chest girth", "IoU, cam01", "IoU, all cameras", "overlay.png"):
        assert word in said
    assert said.index("IoU, all cameras") < said.index(ENERGY_IN_WORDS) < said.index(IOU_IN_WORDS)
    assert "was made or changed by hand" not in command(folder)


@pytest.mark.parametrize(("iou", "is_poor"), [(0.80, True), (0.85, False)])
def test_a_poor_fit_is_said_and_its_measures_have_no_deviation(
    folder: Path, found: TakeFit, capsys: pytest.CaptureFixture[str], iou: float, is_poor: bool
) -> None:
    after = replace(found.fit.after, iou=np.full_like(found.fit.after.iou, iou))
    covariance = 1e-4 * np.eye(len(vector_of(found.actor)))
    fit = replace(found.fit, after=after, shape_covariance=covariance)
    again = concluded(found.frames, found.cameras, found.seen, (found.start, found.start_pose), fit, {}, [])
    assert all((row.uncertainty_cm is None) is is_poor for row in again.measures)
    fit_command.show_fit(again, open_take(folder), folder)
    assert ("body and silhouettes overlap less than usual (0.80)" in capsys.readouterr().out) is is_poor


@pytest.mark.parametrize("body", get_args(BodyName))
def test_the_body_of_the_option_is_fitted(
    folder: Path, found: TakeFit, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, body: BodyName
) -> None:
    fitted: list[object] = []

    def note(*arguments: object, **options: object) -> TakeFit:
        searches = (argument.body for argument in arguments if isinstance(argument, SearchSettings))
        fitted.append(options.get("body", next(searches, None)))
        return found

    for name in ("fit_take", "refine_take"):
        monkeypatch.setattr(fit_command, name, note)
    for refine in ((), ("--refine", str(folder))):
        words = ["fit", str(folder), "--out", str(tmp_path / "out"), "--body", body, *refine]
        assert CliRunner().invoke(cli.app, words).exit_code == 0
    assert fitted == [body, body]


def test_the_body_of_the_search_is_fitted(folder: Path) -> None:
    fitted: list[BodyName] = []

    def fitter(*arguments: Any) -> Fit:
        *given, body, height_m = arguments
        fitted.append(body)
        return stretch(*given, QUICK.body, height_m)

    take, search = open_take(folder), QUICK.model_copy(update={"body": "paper"})
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


def test_the_command_keeps_what_a_person_wrote(folder: Path, command: Callable[..., str]) -> None:
    mine = "height = 1.78\n"
    (folder / "actor.toml").write_text(mine)
    assert "was made or changed by hand" in command(folder)
    assert (folder / "actor.toml").read_text() == mine
    command(folder, "--force")
    assert (folder / "actor.toml").read_text() != mine


def test_the_command_keeps_a_body_that_was_fitted_to_the_whole_take(
    folder: Path, found: TakeFit, command: Callable[..., str], tmp_path: Path
) -> None:
    refined = replace(found, frames=tuple(found.frames))
    write_fit(open_take(folder), refined, folder / "fit")
    write_actor(folder / "actor.toml", refined.actor, "frames of the whole take")
    before = (folder / "actor.toml").read_text()
    assert "was fitted to frames of the whole take" in command(folder)
    assert (folder / "actor.toml").read_text() == before
    assert "IoU, all cameras" in command(folder, "--out", tmp_path / "out")
    assert "IoU, all cameras" in command(folder, "--force")
    assert (folder / "actor.toml").read_text() != before
    assert "IoU, all cameras" in command(folder), "that was a fit to the first frames"


def test_out_leaves_the_take_alone(folder: Path, command: Callable[..., str], tmp_path: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    command(folder, "--out", tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
