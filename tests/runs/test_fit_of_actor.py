"""Live input uses what a fit learnt only for the fit's own actor and cameras."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from services.commands.live import body_in_words
from services.mocap.body.actor import Actor
from services.mocap.camera.calibration import read_calibration, write_calibration
from services.mocap.errors import TakeError
from services.mocap.take.actor_file import write_actor
from services.mocap.take.fit_record import (
    COLOUR_BINS,
    COLOURS,
    FIT_FOLDER,
    RECORD,
    copy_learnt,
    read_colour_tables,
    read_record,
    write_record,
)
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR, CALIBRATION
from services.mocap.take.live import LiveTake, open_live
from services.runs.fit_files import write_fit
from services.runs.live import fit_of_actor
from services.runs.take_fit import TakeFit


@pytest.fixture
def recorded(walk: Path, walk_fit: TakeFit, tmp_path: Path) -> Path:
    """A recording of live input, with the fit of its actor; the calibration of live input is beside it."""
    take, folder = open_take(walk), tmp_path / "recorded"
    fit = folder / FIT_FOLDER
    actor = walk_fit.actor.model_copy(update={"colours": {"torso": (1, 1, 1, 1), "head": (2, 2, 2, 2)}})
    tables = {camera.name: np.ones(COLOUR_BINS, np.uint8) for camera in take.cameras}
    write_fit(take, replace(walk_fit, actor=actor, colour_tables=tables), fit)
    shutil.copy(fit / ACTOR, folder)
    write_calibration(tmp_path / CALIBRATION, take.calibrated, "z")  # of what is written, last digits change
    return folder


def live_take(recorded: Path, actor: str = f"recorded/{ACTOR}", first_lines: str = "") -> LiveTake:
    config = recorded.parent / "live.toml"
    cameras = read_calibration(recorded.parent / CALIBRATION, "z")
    config.write_text(
        f'{first_lines}\nname = "stage"\nfps = 15.0\nup = "z"\ncalibration = "{CALIBRATION}"\n'
        f'actor = "{actor}"\n'
        + "".join(f'[cameras.{one.name}]\nsource = "http://stage/{one.name}"\n' for one in cameras)
    )
    return open_live(config)


def test_a_fit_is_found_beside_its_actor(recorded: Path) -> None:
    fit = recorded / FIT_FOLDER
    assert fit_of_actor(live_take(recorded)) == fit
    assert fit_of_actor(live_take(recorded, f"recorded/{FIT_FOLDER}/{ACTOR}")) == fit
    assert fit_of_actor(live_take(recorded, first_lines="longest_side = 160")) == fit
    (recorded / ACTOR).unlink()
    assert fit_of_actor(live_take(recorded)) is None


def test_a_fit_counts_for_its_own_actor_only(recorded: Path) -> None:
    write_actor(recorded / ACTOR, Actor(height=1.9), "nothing")
    assert fit_of_actor(live_take(recorded)) is None
    (recorded / ACTOR).write_text("height = 0")
    with pytest.raises(TakeError, match="height"):
        fit_of_actor(live_take(recorded))


def test_a_fit_counts_for_its_own_cameras_only(recorded: Path) -> None:
    fit, calibration = recorded / FIT_FOLDER, recorded.parent / CALIBRATION
    cameras = read_calibration(calibration, "z")
    swapped = tuple(replace(one, name=other.name) for one, other in zip(cameras, cameras[::-1], strict=True))
    write_calibration(calibration, swapped, "z")
    assert fit_of_actor(live_take(recorded)) is None
    write_calibration(calibration, (*cameras, replace(cameras[0], name="new")), "z")
    assert fit_of_actor(live_take(recorded)) is None
    write_calibration(calibration, cameras, "z")
    assert fit_of_actor(live_take(recorded)) == fit
    record = read_record(fit)
    assert record is not None
    write_record(fit, record.model_copy(update={"projections": {}}))  # of an earlier version
    assert fit_of_actor(live_take(recorded)) is None


def test_whether_colours_count_is_said(recorded: Path) -> None:
    take, fit = live_take(recorded), recorded / FIT_FOLDER
    body = f"body: {recorded / ACTOR}"
    assert body_in_words(take, fit, with_colours=True) == f"{body} with its colours"
    assert body_in_words(take, fit, with_colours=False) == body
    lacking = f"{body}, not its colours: no fit beside it saw them with these cameras"
    assert body_in_words(take, None, with_colours=True) == lacking
    (fit / COLOURS).unlink()
    assert body_in_words(take, fit, with_colours=True) == lacking


def test_what_a_fit_learnt_is_copied_without_its_poses(recorded: Path, tmp_path: Path) -> None:
    fit, copy, cameras = recorded / FIT_FOLDER, tmp_path / "copy", live_take(recorded).cameras
    copy_learnt(fit, copy)
    assert {path.name for path in copy.iterdir()} == {RECORD, COLOURS}
    assert read_record(copy) == read_record(fit)
    assert read_colour_tables(copy, cameras).keys() == {camera.name for camera in cameras}
    copy_learnt(copy, copy.parent / "again")
    assert (tmp_path / "again" / COLOURS).read_bytes() == (fit / COLOURS).read_bytes()
