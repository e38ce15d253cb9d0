"""`xormocap calibrate` on a real recording: a board that is white on black, no picture of the origin."""

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from typer.testing import CliRunner

from services.cli import app
from services.mocap.calibration import from_clips
from services.mocap.calibration.clips import Clip
from services.mocap.calibration.detection import Detector
from services.mocap.calibration.sightings import Sightings
from services.mocap.camera.calibration import read_calibration
from services.mocap.camera.camera import Camera
from services.mocap.camera.formats import read_any
from services.mocap.types import Floats

BOARD = ("--squares", "4x5", "--square", "0.054", "--dictionary", "4x4_1000")


@pytest.fixture(scope="module")
def recording() -> Path:
    folder = Path(__file__).resolve().parents[3] / "shared" / "data" / "boards" / "caliscope"
    if not folder.is_dir():
        pytest.skip("needs the recording of a board")
    return folder


@pytest.fixture
def looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs after the first one take its sightings of the board: to find them takes seconds."""
    look = from_clips._sightings
    detectors: list[Detector] = []

    @cache
    def first(clip: Clip, moments: frozenset[int], folder: Path, camera: int, n_cameras: int) -> Sightings:
        return look(clip, moments, folder, detectors[-1], camera, n_cameras)

    def again(
        clip: Clip, moments: frozenset[int], folder: Path, detector: Detector, camera: int, n_cameras: int
    ) -> Sightings:
        detectors.append(detector)
        return first(clip, moments, folder, camera, n_cameras)

    monkeypatch.setattr(from_clips, "_sightings", again)


def calibrate(recording: Path, out: Path, *options: object) -> tuple[str, tuple[Camera, ...]]:
    """What the command warns of, and the cameras that it writes."""
    arguments = ["calibrate", recording / "calibration" / "extrinsic", "--out", out, *BOARD, *options]
    done = CliRunner().invoke(app, list(map(str, arguments)), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output, read_calibration(out, "z")


def between_m(cameras: tuple[Camera, ...]) -> Floats:
    """Distances between all pairs of cameras."""
    return np.asarray(pdist([camera.centre_world_m for camera in cameras]), np.float64)


@pytest.mark.usefixtures("looked_at_once")
def test_it_calibrates_as_it_is_and_says_what_it_lacks(recording: Path, tmp_path: Path) -> None:
    reference = recording / "camera_array.toml"
    true_m = between_m(read_any(reference, None, None, "auto", 1.0, "z")[0])
    said, cameras = calibrate(recording, tmp_path / "calibration.toml")
    assert np.abs(between_m(cameras) / true_m - 1).max() < 0.06
    assert "warning: the board is printed white on black (inverted = true)\n" in said
    assert said.count("warning: ") == 4
    assert said.index("origin: has no clip") < said.index("calibrated") < said.index("white on black")
    assert re.search(r"cam_1 \(1\.\d\d px\), cam_2 \(1\.\d\d px\): corners are off by too much", said)
    every = ", ".join(rf"{camera.name} \(\d\d%\)" for camera in cameras)
    assert re.search(f"warning: {every}: the board was seen in this share of the picture only", said)
    assert "(a simple lens model was chosen): move the board through the whole picture" in said
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert sorted(first) == ["calibration.json", "calibration.toml", "coverage.png"]
    record = json.loads(first["calibration.json"])
    assert len(record["warnings"]) == 4
    assert min(of["views"] + of["left_out"] for of in record["cameras"].values()) >= 40

    said, cameras = calibrate(recording, tmp_path / "known.toml", "--lens", reference)
    assert np.abs(between_m(cameras) / true_m - 1).max() < 0.03
    assert "the board was seen in" not in said
    assert {path.name for path in tmp_path.iterdir()} - first.keys() == {
        "known.json",
        "known.toml",
        "known-coverage.png",
    }
    assert {name: (tmp_path / name).read_bytes() for name in first} == first
