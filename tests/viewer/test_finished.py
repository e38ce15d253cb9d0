"""Results as a show, with their take and without."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from services.commands.view import finished_show
from services.mocap.camera.rig import Rig
from services.mocap.errors import UserError
from services.mocap.export.tiles import CLASSES_BGR
from services.mocap.result.result import load_result
from services.mocap.take.actor_file import read_actor
from services.mocap.take.fit_record import (
    COLOUR_BINS,
    FIT_FOLDER,
    FitRecord,
    write_colour_tables,
    write_record,
)
from services.mocap.take.folder import Take
from services.mocap.take.layout import ACTOR
from services.mocap.take.tables import read_poses_csv, write_poses_csv
from services.viewer.picture_sources import TakePictures
from services.viewer.tiles import Look, TileArtist


def test_results_with_their_take(result: Path, walk: Take) -> None:
    show = finished_show(result, None)
    assert not show.is_live and show.history.is_over and show.history.newest == 23
    assert show.camera_names == tuple(camera.name for camera in walk.cameras)
    solved = show.history.solved(7)
    assert solved is not None and show.artist is not None
    np.testing.assert_array_equal(solved.pose, read_poses_csv(result / "poses.csv").poses[7])
    (tile,) = show.artist.draw(solved, Look("difference", (2,), None))
    assert tile.differing_px is not None and 0 < tile.differing_px < 500  # the true pose before a real mask


def test_results_without_their_take_show_the_body_and_say_what_is_missing(result: Path) -> None:
    (result / "run.json").write_text('{"take": {"folder": "/gone"}}')
    show = finished_show(result, None)
    assert show.rig is None and show.artist is None and show.camera_names == ()
    assert "give --take to see its cameras" in show.remark
    assert show.fps == pytest.approx(15)


def test_results_of_another_take_are_refused(result: Path, walk: Take) -> None:
    (result / "run.json").write_text('{"take": {"name": "dance"}}')
    with pytest.raises(UserError, match="is of 'dance', not of 'walk' in "):
        finished_show(result, walk.folder)


def test_live_results_ask_for_their_recording_and_show_the_pictures_of_its_shots(
    result: Path, walk: Take
) -> None:
    table = read_poses_csv(result / "poses.csv")
    last = table.poses.shape[0] - 1
    shots = np.minimum(2.0 * table.frames, last)  # every other shot was too late
    write_poses_csv(result / "poses.csv", replace(table, extra={"shot": shots}))
    (result / "run.json").write_text(json.dumps({"live": {}, "take": {"folder": str(result)}}))
    assert "give --take, their recording" in finished_show(result, None).remark
    show = finished_show(result, walk.folder)
    solved = show.history.solved(5)
    assert solved is not None and show.artist is not None
    (tile,) = show.artist.draw(solved, Look("picture", (2,), None))
    (expected,) = TileArtist(
        load_result(result).motion.body, Rig.of(walk.cameras), TakePictures(walk, None)
    ).draw(replace(solved, frame=10), Look("picture", (2,), None))
    assert tile.jpeg == expected.jpeg


@pytest.mark.parametrize("is_its_fit", [True, False])
def test_colours_are_those_of_the_fit_of_the_result_s_actor(
    result: Path, walk: Take, is_its_fit: bool
) -> None:
    actor = read_actor(result / ACTOR)
    fit = result / FIT_FOLDER
    fit.mkdir()
    record = FitRecord(
        actor=actor.content_hash if is_its_fit else "0" * 64, first_frame=0, end_frame=1, hints={},
        energy_before_px=[], energy_after_px=[], iou_before={}, iou_after={}, seconds={}, warnings=[],
    )  # fmt: skip
    write_record(fit, record)
    write_colour_tables(fit, {walk.cameras[2].name: np.full(COLOUR_BINS, 3, np.uint8)})
    show = finished_show(result, None)
    solved = show.history.solved(7)
    assert solved is not None and show.artist is not None
    (tile,) = show.artist.draw(solved, Look("colours", (2,), None))
    shown = cv2.imdecode(np.frombuffer(tile.jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
    n_coloured = np.count_nonzero(np.abs(shown - CLASSES_BGR[2]).max(axis=2) < 30)
    assert n_coloured > 300 if is_its_fit else n_coloured == 0
    assert bool(tile.missing) == (not is_its_fit)


def test_the_take_may_be_elsewhere(result: Path, walk: Take) -> None:
    (result / "run.json").unlink()
    assert finished_show(result, None).artist is None
    assert finished_show(result, walk.folder).artist is not None


def test_what_is_no_result_is_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"has no poses\.csv: expected a results folder"):
        finished_show(tmp_path, None)
