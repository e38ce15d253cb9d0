"""`xormocap calibrate TAKE --refine RESULT`: a camera that was knocked, found again by the tracked actor."""

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.commands.calibrate.refine import REFINED
from services.mocap.camera.calibration import write_calibration
from services.mocap.camera.camera import moved_by
from services.mocap.result.result import load_result, open_take_of
from services.mocap.take.fit_record import FIT_FOLDER
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR, CALIBRATION
from services.mocap.take.moved_cameras import moves_of, take_of_fit
from services.mocap.verdict.judging import verdict_of

Command = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def knocked_take(exact_take: Path, tmp_path: Path) -> Path:
    """The take with cam02 turned by 1 degree since its calibration."""
    take = tmp_path / "walk"
    shutil.copytree(exact_take, take)
    opened = open_take(take)
    cameras = list(opened.cameras)
    R = Rotation.from_rotvec(np.radians([0.6, -0.8, 0.0])).as_matrix() @ cameras[1].R_camera_world
    cameras[1] = replace(cameras[1], R_camera_world=R, t_camera_world_m=-R @ cameras[1].centre_world_m)
    write_calibration(take / CALIBRATION, tuple(cameras), opened.settings.up)
    return take


@pytest.fixture
def result(xormocap: Command, exact_take: Path, tmp_path: Path) -> Path:
    """The whole take, tracked before the camera was knocked."""
    out = tmp_path / "result"
    one_way = ("--set", "both_ways=false")
    done = xormocap(
        "track", exact_take, "--out", out, "--workers", 1, "--no-overlay", "--no-refine", *one_way
    )
    assert done.returncode == 0, done.stderr
    return out


def test_the_knocked_camera_comes_back_and_the_given_file_stays(
    knocked_take: Path, exact_take: Path, result: Path, xormocap: Command, refused: Callable[..., str]
) -> None:
    given = (knocked_take / CALIBRATION).read_bytes()
    done = xormocap("calibrate", knocked_take, "--refine", result)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.split())
    assert len(re.findall(r"- - held", said)) == 4
    assert f"mv {knocked_take / REFINED} {knocked_take / CALIBRATION}" in said
    assert (knocked_take / CALIBRATION).read_bytes() == given
    (knocked_take / REFINED).rename(knocked_take / CALIBRATION)
    true, found = open_take(exact_take).cameras, open_take(knocked_take).cameras
    turned_deg, moved_mm = moved_by(found[1], true[1])
    assert turned_deg < 0.1
    assert moved_mm < 10

    given = (knocked_take / CALIBRATION).read_bytes()
    said = refused("calibrate", exact_take, "--refine", result)
    assert "no camera moves: nothing is written" in " ".join(said.split())
    said = refused("calibrate", knocked_take, "--refine", result, "--out", knocked_take / CALIBRATION)
    assert "is the calibration that is refined: name another file" in " ".join(said.split())
    said = refused("calibrate", "--refine", result)
    assert "expected the take as well: calibrate TAKE --refine RESULT" in " ".join(said.split())
    assert (knocked_take / CALIBRATION).read_bytes() == given


def test_a_take_is_tracked_with_its_cameras_where_the_first_run_shows_them(
    knocked_take: Path, exact_take: Path, xormocap: Command, tmp_path: Path
) -> None:
    out, given = tmp_path / "out", (knocked_take / CALIBRATION).read_bytes()
    done = xormocap("track", knocked_take, "--out", out, "--workers", 1, "--no-overlay", "--refine")
    assert done.returncode == 0, done.stderr
    assert (knocked_take / CALIBRATION).read_bytes() == given
    result = load_result(out)
    assert list(result.run["fit"]["moved"]) == ["cam02"]
    true, used = open_take(exact_take).cameras, open_take_of(result, knocked_take).cameras
    turned_deg, moved_mm = moved_by(used[1], true[1])
    assert turned_deg < 0.1
    assert moved_mm < 10
    assert result.run["accuracy"]["mean_mm"] < 3
    assert result.energies_px.max() < 150  # 800 and more with the camera where it is not
    (said,) = (cause for cause in verdict_of(result).causes if "not where calibration.toml" in cause.what)
    assert "cam02 (by 1.0 degrees" in said.what
    kept = out / CALIBRATION
    assert str(kept) in said.remedy
    assert said.model_dump() in result.run["verdict"]["causes"]
    assert (out / FIT_FOLDER / CALIBRATION).exists()

    # The fit's cameras go with its body: stored in the take, they are used by later runs, and only with it.
    stored = xormocap("fit", knocked_take, "--refine", out, "--no-check")
    assert stored.returncode == 0, stored.stderr
    assert list(moves_of(take_of_fit(open_take(knocked_take)))) == ["cam02"]
    (knocked_take / ACTOR).unlink()
    assert not moves_of(take_of_fit(open_take(knocked_take)))

    # With what the remedy says the calibration is right, and the results' cameras are its own.
    shutil.copy(kept, knocked_take / CALIBRATION)
    assert not moves_of(open_take_of(result, knocked_take))
