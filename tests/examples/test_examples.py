"""The examples run, and do what they say."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import services.mocap
from services.mocap.errors import UserError
from services.mocap.take.tables import read_poses_csv, write_poses_csv

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "scripts" / "examples"


def example(name: str, *arguments: object) -> str:
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_tried() -> None:
    assert {path.name for path in EXAMPLES.iterdir()} == {"plot_angle.py", "compare.py", "render_frame.py"}


def test_plot_angle(bare_result: Path, tmp_path: Path) -> None:
    example("plot_angle.py", bare_result, tmp_path / "hip.png", "hip_flexion")
    picture = cv2.imread(str(tmp_path / "hip.png"))
    assert picture.shape == (300, 800, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50


def test_compare(bare_result: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(bare_result, tmp_path / "other"))
    table = read_poses_csv(other / "poses.csv")
    table.poses[4, 2] += 0.12
    write_poses_csv(other / "poses.csv", table)
    said = example("compare.py", bare_result, other).splitlines()
    assert said[0] == "16 frames in common, joints 7.5 mm apart in the mean"
    assert len(said) == 16
    assert all(line.endswith("7.5 mm, at most  120.0 mm in frame 104") for line in said[1:])


def test_render_frame(bare_result: Path, small_take: Callable[..., Path], tmp_path: Path) -> None:
    take = small_take(frames=104, source="silhouettes")
    example("render_frame.py", bare_result, take, "cam02", 101, tmp_path / "frame.png")
    picture = cv2.imread(str(tmp_path / "frame.png"))
    assert picture.shape == (720, 960, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20  # a body, not just a silhouette


def test_a_frame_or_camera_that_is_not_there(bare_result: Path, small_take: Callable[..., Path]) -> None:
    from services.mocap import draw_frame, load_result, open_take

    result, take = load_result(bare_result), open_take(small_take(frames=104, source="silhouettes"))
    with pytest.raises(UserError, match="cam3: unknown camera: did you mean cam0"):
        draw_frame(result, take, "cam3", 101)
    with pytest.raises(UserError, match="frame 99: expected one from 100 to 115"):
        draw_frame(result, take, "cam01", 99)


def test_all_that_the_library_offers_is_there() -> None:
    for name in services.mocap.__all__:
        assert getattr(services.mocap, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'load_results'"):
        _ = services.mocap.load_results
