"""fit.json vouches for the poses of a fit: for its own actor and what take.toml then said, no others."""

from pathlib import Path

import numpy as np
import pytest

from services.mocap.body.actor import Actor
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.camera import Camera
from services.mocap.errors import TakeError
from services.mocap.take.fit_record import (
    COLOUR_BINS,
    COLOURS,
    POSES,
    RECORD,
    FitRecord,
    hints_of,
    known_poses,
    read_colour_tables,
    read_record,
    was_refined,
    write_colour_tables,
    write_record,
)
from services.mocap.take.settings import TakeSettings
from services.mocap.take.tables import PoseTable, write_poses_csv

ACTOR = Actor(height=1.8)
POSE_TABLE = PoseTable(
    np.arange(3, dtype=np.int32), np.arange(3) / 10, 0.01 * np.arange(3.0 * N_DOF).reshape(3, -1), np.ones(3)
)


def _settings(**fields: object) -> TakeSettings:
    told = {"name": "t", "fps": 10.0, "units": "m", "up": "z", "frames": 9, **fields}
    return TakeSettings.model_validate(told)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    record = FitRecord(
        actor=ACTOR.content_hash,
        first_frame=0,
        end_frame=3,
        hints=hints_of(_settings(facing=30.0)),
        energy_before_px=[9.0, 9.0, 9.0],
        energy_after_px=[1.0, 1.0, 1.0],
        iou_before={"cam01": 0.5},
        iou_after={"cam01": 0.9},
        seconds={"all": 1.0},
        warnings=[],
    )
    write_poses_csv(tmp_path / POSES, POSE_TABLE)
    write_record(tmp_path, record)
    return tmp_path


def test_the_poses_are_found_by_frame(folder: Path) -> None:
    poses = known_poses(folder, ACTOR, _settings(facing=30.0))
    assert list(poses) == [0, 1, 2]
    assert np.allclose(list(poses.values()), POSE_TABLE.poses, atol=1e-6)


def test_it_is_known_whether_a_body_was_fitted_to_the_whole_take(folder: Path) -> None:
    assert was_refined(folder, ACTOR) is False
    assert was_refined(folder, Actor(height=1.81)) is None
    assert was_refined(folder / "nowhere", ACTOR) is None
    record = read_record(folder)
    assert record is not None
    write_record(folder, record.model_copy(update={"is_refined": True}))
    assert was_refined(folder, ACTOR) is True


def test_there_are_none_for_other_actors_and_hints(folder: Path, tmp_path: Path) -> None:
    told = _settings(facing=30.0)
    assert known_poses(folder, Actor(height=1.81), told) == {}
    assert known_poses(folder, ACTOR, _settings(facing=210.0)) == {}
    assert known_poses(folder, ACTOR, _settings(facing=30.0, initial_pose={"root_z_m": 0.9})) == {}
    assert known_poses(tmp_path / "nowhere", ACTOR, told) == {}


@pytest.mark.parametrize("text", ["", "{}", "[1", '{"actor": "me"}'])
def test_a_damaged_record_is_said(folder: Path, text: str) -> None:
    (folder / RECORD).write_text(text)
    with pytest.raises(TakeError, match=r"fit\.json: is not a file of xormocap fit"):
        known_poses(folder, ACTOR, _settings())


def test_missing_poses_are_said(folder: Path) -> None:
    (folder / POSES).unlink()
    with pytest.raises(TakeError, match=r"poses\.csv: is missing"):
        known_poses(folder, ACTOR, _settings(facing=30.0))


def _camera(name: str) -> Camera:
    return Camera(name, 64, 48, np.diag([60.0, 60.0, 1.0]), np.zeros(4), np.eye(3), np.zeros(3))


CAMERAS = [_camera("cam01"), _camera("cam02")]


def test_colour_tables_are_kept_by_camera_and_go_with_the_next_fit(tmp_path: Path) -> None:
    table = np.random.default_rng(0).integers(0, 8, COLOUR_BINS).astype(np.uint8)
    write_colour_tables(tmp_path, {"cam01": table, "gone": table})
    found = read_colour_tables(tmp_path, CAMERAS)
    assert found.keys() == {"cam01"}
    np.testing.assert_array_equal(found["cam01"], table)
    write_colour_tables(tmp_path, {})
    assert read_colour_tables(tmp_path, CAMERAS) == {}


@pytest.mark.parametrize(
    "table", [np.full(COLOUR_BINS, 8, np.uint8), np.zeros((4, 4, 4), np.uint8), np.zeros(COLOUR_BINS)]
)
def test_a_table_without_sense_is_refused(tmp_path: Path, table: np.ndarray) -> None:
    np.savez(tmp_path / COLOURS, **{"camera:cam02": table})
    with pytest.raises(TakeError, match=r"colours\.npz: cam02: is not a table of colour classes: remove it"):
        read_colour_tables(tmp_path, CAMERAS)


@pytest.mark.parametrize("content", [b"no archive", b"", b"\x93NUMPY"])
def test_another_file_in_its_place_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / COLOURS).write_bytes(content)
    with pytest.raises(
        TakeError, match=r"colours\.npz: is not a file of xormocap fit: remove it or fit again"
    ):
        read_colour_tables(tmp_path, CAMERAS)
