"""The files of a fit."""

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from replaced_fit import FILES
from services.mocap.body.kinematics import N_DOF
from services.mocap.errors import TakeError
from services.mocap.take.actor_file import read_actor
from services.mocap.take.fit_record import OCCLUDED, known_poses, read_occluded, read_record
from services.mocap.take.folder import open_take
from services.mocap.take.tables import PoseTable
from services.mocap.types import UNSURE, Mask
from services.runs.fit_files import write_fit
from services.runs.take_fit import TakeFit
from services.segmentation.segmenters import make_segmenter


def test_all_files_are_written_and_belong_together(walk: Path, walk_fit: TakeFit, tmp_path: Path) -> None:
    take, out = open_take(walk), tmp_path / "out"
    for _ in range(2):  # a second fit takes the place of the first
        write_fit(take, walk_fit, out)
        assert {path.name for path in out.iterdir()} == FILES
    actor = read_actor(out / "actor.toml")
    assert actor == walk_fit.actor
    poses = known_poses(out, actor, take.settings)
    assert list(poses) == [0, 1, 2]
    assert np.allclose(list(poses.values()), walk_fit.fit.poses, atol=1e-6)
    record = read_record(out)
    assert record is not None
    assert record.iou_after.keys() == {"cam01", "cam02", "cam03"}
    assert record.energy_before_px == walk_fit.fit.before.energy_px.tolist()


def test_poses_of_a_run_are_kept_for_frames_that_were_not_fitted(
    walk: Path, walk_fit: TakeFit, tmp_path: Path
) -> None:
    take, frames = open_take(walk), np.arange(5, dtype=np.int32)
    run = PoseTable(frames, frames / take.settings.fps, np.full((5, N_DOF), 0.25), np.full(5, 900.0))
    write_fit(take, replace(walk_fit, run_poses=run), tmp_path)
    poses = known_poses(tmp_path, walk_fit.actor, take.settings)
    assert list(poses) == [0, 1, 2, 3, 4]
    assert np.allclose([poses[frame] for frame in range(3)], walk_fit.fit.poses, atol=1e-6)
    assert np.all([poses[3] == 0.25, poses[4] == 0.25])


def test_what_hides_the_actor_is_kept_with_the_fit(walk: Path, walk_fit: TakeFit, tmp_path: Path) -> None:
    take = open_take(walk)
    camera = take.cameras[1]
    mask: Mask = np.zeros(camera.shape_px, bool)
    mask[100:140, 30:90] = True
    write_fit(take, replace(walk_fit, occluded={camera.name: mask}), tmp_path)
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
    write_fit(take, walk_fit, tmp_path)  # a fit that knows of nothing
    assert not read_occluded(tmp_path, take.cameras)


def test_measures_and_pictures_can_be_read(walk: Path, walk_fit: TakeFit, tmp_path: Path) -> None:
    write_fit(open_take(walk), walk_fit, tmp_path)
    with (tmp_path / "measures.csv").open(newline="") as file:
        rows = {row["measure"]: float(row["cm"]) for row in csv.DictReader(file)}
    assert rows["height"] == pytest.approx(176.5, abs=0.3)
    for name in ("overlay.png", "turntable.png"):
        assert cv2.imread(str(tmp_path / name)).std() > 10
