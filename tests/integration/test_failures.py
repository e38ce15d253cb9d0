"""What happens when something dies or is stopped in the middle of a take."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from services.launcher import Launcher
from services.mocap.take.folder import open_take
from services.mocap.take.tables import read_poses_csv
from services.track import Progress, track

pytestmark = pytest.mark.timeout(280)


def _alive(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _children(pid: int) -> list[int]:
    return [child.pid for child in psutil.Process(pid).children()]


def _wait_until(condition, timeout_s: float) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.1)
    return False


def test_a_killed_limb_worker_costs_no_frame_and_changes_none(
    synthetic_take: Path, tracked: Path, tmp_path: Path
) -> None:
    launchers: list[Launcher] = []
    killed: list[int] = []

    def show(progress: Progress) -> None:
        if progress.frames_done >= 2 and not killed:
            killed.append(launchers[0].pids("limb_worker")[0])
            os.kill(killed[0], signal.SIGKILL)

    report = track(
        open_take(synthetic_take),
        tmp_path / "out",
        workers=4,
        frames="14:20",
        overlay=False,
        show=show,
        started=launchers.append,
    )
    assert killed
    assert report["take"]["frames"] == 6
    assert (tmp_path / "out" / "poses.csv").read_text() == (tracked / "poses.csv").read_text()


@pytest.fixture
def running(synthetic_take: Path, tmp_path: Path):
    """A run of the command, in its first frames."""
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "services.cli",
            "track",
            synthetic_take,
            "--out",
            tmp_path / "out",
            "--frames",
            "8:24",
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert _wait_until(lambda: len(_children(process.pid)) == 7, 30)
    yield process
    process.kill()
    process.wait()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_leaves_complete_files_and_no_process(
    running: "subprocess.Popen[str]", number: signal.Signals, tmp_path: Path
) -> None:
    children = _children(running.pid)
    time.sleep(14)  # the first pose takes a while; whether a frame is done by then is not promised
    running.send_signal(number)
    assert running.wait(60) == 130
    assert not any(_alive(pid) for pid in children)
    if (tmp_path / "out").exists():
        frames = read_poses_csv(tmp_path / "out" / "poses.csv").frames.tolist()
        assert frames == list(range(8, 8 + len(frames)))
        assert (tmp_path / "out" / "run.json").exists()
    assert {path.name for path in tmp_path.iterdir()} <= {"out"}


def test_no_process_outlives_a_killed_launcher(running: "subprocess.Popen[str]") -> None:
    children = _children(running.pid)
    running.kill()
    running.wait()
    assert _wait_until(lambda: not any(_alive(pid) for pid in children), 40)
