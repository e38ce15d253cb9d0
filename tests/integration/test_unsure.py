"""Silhouettes of which much is unsure, from a take's files over the wire to poses: what is sure suffices."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from busy import ONE_WAY

from services.mocap.body.actor import build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.take.actor_file import read_actor
from services.mocap.take.layout import ACTOR
from services.mocap.take.tables import read_poses_csv

pytestmark = pytest.mark.usefixtures("no_report")
Command = Callable[..., object]
_FRAMES = 6
_GREY = 90
"""What take.toml here calls unsure, and would be background otherwise."""


def _soiled(grey: np.ndarray) -> np.ndarray:
    """A silhouette (H, W) whose actor is unsure from the shins down, with a column beside and specks."""
    rng, rows = np.random.default_rng(0), np.flatnonzero(grey.any(axis=1))
    soiled = grey.copy()
    soiled[rows[0] + round(0.85 * len(rows)) :] = _GREY
    soiled[:, :60] = _GREY
    soiled[rng.random(grey.shape) < 0.02] = _GREY
    return soiled


@pytest.fixture
def doubtful_take(known_take: Path, tmp_path: Path) -> Path:
    """The first frames of the known take as a matte gives them."""
    take = tmp_path / "doubtful"
    shutil.copytree(known_take, take, ignore=shutil.ignore_patterns("videos", "background", "silhouettes"))
    for path in sorted((known_take / "reference" / "silhouettes").glob(f"*/00000[0-{_FRAMES - 1}].png")):
        target = take / "silhouettes" / path.parent.name / path.name
        target.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(target), _soiled(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)))
    settings = (take / "take.toml").read_text()
    settings = settings.replace("init_frames = 10\n", "").replace("frames = 24", f"frames = {_FRAMES}")
    (take / "take.toml").write_text(f"unsure = [{_GREY - 30}, {_GREY + 30}]\n" + settings)
    return take


def _off_mm(take: Path, out: Path) -> float:
    """How far joints are off, on average."""
    offsets_m = build_body(read_actor(take / ACTOR)).offsets_m
    found, true = (
        joint_positions(read_poses_csv(path).poses[:_FRAMES], offsets_m)
        for path in (out / "poses.csv", take / "reference" / "poses.csv")
    )
    return float(1000 * np.linalg.norm(found - true, axis=-1).mean())


def test_what_is_sure_suffices(doubtful_take: Path, xormocap: Command, tmp_path: Path) -> None:
    done = xormocap(
        "track", doubtful_take, "--out", tmp_path / "out", "--workers", 1, "--no-overlay", *ONE_WAY
    )
    assert done.returncode == 0, done.stderr
    assert "silhouettes:" not in done.stderr  # no remark on the first frame
    assert _off_mm(doubtful_take, tmp_path / "out") < 15
    table = read_poses_csv(tmp_path / "out" / "poses.csv")
    assert table.marks is not None
    assert not table.marks.distrusted.any()
    assert table.energies_px.max() < 600
