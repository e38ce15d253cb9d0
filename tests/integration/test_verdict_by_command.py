"""`xormocap track` ends with the verdict, its causes and, if it is strict, an exit code."""

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from busy import SHORT

from services.mocap.types import Bytes

pytestmark = pytest.mark.timeout(280)


@pytest.fixture
def take(exact_take: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(exact_take, tmp_path / "walk"))


def _another_height(take: Path) -> None:
    settings = take / "take.toml"
    settings.write_text(settings.read_text().replace("actor_height = 1.75", "actor_height = 1.5"))


def _a_giant(take: Path) -> None:
    settings, actor = take / "take.toml", take / "actor.toml"
    settings.write_text(settings.read_text().replace("actor_height = 1.75", ""))
    actor.write_text(re.sub(r"^height = .*", "height = 2.2", actor.read_text(), flags=re.MULTILINE))


def _change(take: Path, camera: str, change: Callable[[Bytes], Bytes], first: int = 0) -> None:
    for path in sorted((take / "silhouettes" / camera).iterdir())[first:]:
        cv2.imwrite(str(path), change(np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)))


def _one_camera_wide(take: Path) -> None:
    _change(take, "cam03", lambda shown: np.asarray(cv2.dilate(shown, np.ones((13, 13))), np.uint8))


def _leaves(take: Path) -> None:
    def upper_part(shown: Bytes) -> Bytes:
        rows = np.flatnonzero(shown.any(axis=1))
        shown[rows[len(rows) // 2] :] = 0
        return shown

    for camera in ("cam01", "cam02", "cam03", "cam04"):
        _change(take, camera, upper_part, first=8)


@pytest.mark.parametrize(
    ("damage", "cause", "level"),
    [
        (
            _another_height,
            r"the body is 1\.\d\d m tall, take.toml says actor_height = 1.50",
            "usable with gaps",
        ),
        (_a_giant, "the fitted body is 2.20 m tall, as hardly anybody", "not usable"),
        (_one_camera_wide, r"cam03 agrees less with the body than the others \(IoU 0", "usable with gaps"),
        (_leaves, "most cameras' silhouettes stop matching the body in frames 8 to 15: ", "not usable"),
    ],
)
def test_a_cause_is_told_at_the_end_and_in_the_results(
    take: Path,
    xormocap: Callable[..., "subprocess.CompletedProcess[str]"],
    tmp_path: Path,
    damage: Callable[[Path], None],
    cause: str,
    level: str,
) -> None:
    damage(take)
    done = xormocap("track", take, "--out", tmp_path / "out", *SHORT, "--frames", "0:16", "--strict")
    verdict = json.loads((tmp_path / "out" / "run.json").read_text())["verdict"]
    assert any(re.match(cause, found["what"]) for found in verdict["causes"]), verdict["causes"]
    assert re.search(f"^  cause: {cause}", done.stdout, flags=re.MULTILINE), done.stdout
    assert f"verdict: {level}: " in done.stdout
    assert verdict["level"] == level
    assert done.returncode == (3 if level == "not usable" else 0)
