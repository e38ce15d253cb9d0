"""Frames to show, a take, a coordinator that only plays back, the viewer's process, a browser."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from bench.chromium import chromium_path, open_chromium
from known_actor import write_take_of_known_actor
from playback import Playback
from services.mocap.body.kinematics import N_DOF
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import ACTOR
from services.mocap.take.marks import PARTS
from services.mocap.take.quantities import STAGES
from services.runs import launcher
from services.viewer.solved_frame import ON_PAGE, SolvedFrame


@pytest.fixture
def solved() -> Callable[..., SolvedFrame]:
    """`solved(7)`: frame 7, whose pose, energy and confidence tell it from others."""

    def make(frame: int, *, distrusted: tuple[str, ...] = (), arrived_s: float = np.nan) -> SolvedFrame:
        known = {
            "energy_px": [100.0 + frame],
            "confidence": [0.5] * len(PARTS),
            "distrusted": [float(part in distrusted) for part in PARTS],
            "part_px": [10.0 + frame] * len(PARTS),
            "seconds": [0.04] * len(STAGES),
        }
        numbers = [number for row in ON_PAGE for number in known.get(row.name, [np.nan] * len(row.labels))]
        return SolvedFrame(frame, frame / 25, np.full(N_DOF, 0.001 * frame), np.array(numbers), arrived_s)

    return make


@pytest.fixture(scope="session")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Take:
    """A take of eight cameras, its actor and its poses known."""
    folder = tmp_path_factory.mktemp("viewer") / "walk"
    write_take_of_known_actor(folder, n_frames=24, n_cameras=8)
    return open_take(folder)


@pytest.fixture(scope="session")
def write_true_result(walk: Take) -> Callable[[Path], Path]:
    """`write_true_result(folder)` writes results of that take, its true poses, into a folder of this one."""

    def write(parent: Path) -> Path:
        folder = parent / "result"
        folder.mkdir()
        shutil.copy(walk.folder / "reference" / "poses.csv", folder)
        shutil.copy(walk.folder / ACTOR, folder)
        (folder / "run.json").write_text(f'{{"take": {{"name": "walk", "folder": "{walk.folder}"}}}}')
        return folder

    return write


@pytest.fixture
def result(write_true_result: Callable[[Path], Path], tmp_path: Path) -> Path:
    """Results of that take: its true poses."""
    return write_true_result(tmp_path)


@pytest.fixture
def playback(walk: Take) -> Iterator[Playback]:
    """A coordinator that plays the take's true poses over and over, ten a second."""
    with Playback(walk, launcher.free_endpoint()) as running:
        yield running


Viewer = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start_viewer(tmp_path: Path) -> Iterator[Viewer]:
    """`start_viewer("--connect", …)` starts the viewer's process and waits until it says where to look."""
    with _viewers(tmp_path) as start:
        yield start


@pytest.fixture(scope="module")
def start_lasting_viewer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewer]:
    """The same for several tests."""
    with _viewers(tmp_path_factory.mktemp("viewers")) as start:
        yield start


@contextmanager
def _viewers(logs: Path) -> Iterator[Viewer]:
    running: list[subprocess.Popen[str]] = []

    def start(*arguments: object, module: tuple[str, ...] = ("services.viewer",)) -> "subprocess.Popen[str]":
        log = logs / f"viewer-{len(running)}.log"
        # The browser draws on the same cores.
        nice = ("--nice", "0") if module == ("services.viewer",) else ()
        command = [sys.executable, "-m", *module, *map(str, arguments), *nice]
        with log.open("w") as file:
            process = subprocess.Popen(command, stdout=file, stderr=file, text=True)
        running.append(process)
        deadline_s = time.monotonic() + 60
        while "open http" not in log.read_text():
            assert process.poll() is None and time.monotonic() < deadline_s, log.read_text()
            time.sleep(0.1)
        return process

    yield start
    for process in running:
        process.send_signal(signal.SIGTERM)
    for process in running:
        process.wait(20)


@pytest.fixture
def free_port() -> int:
    """A port of this machine's loopback that is free at this moment."""
    return launcher.free_port()


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """A browser; tests that want one are skipped where there is none."""
    if chromium_path() is None:
        if os.environ.get("XORMOCAP_REQUIRE_CHROMIUM"):
            pytest.fail("there is no chromium, and XORMOCAP_REQUIRE_CHROMIUM is set")
        pytest.skip("there is no chromium")
    with open_chromium() as browser:
        yield browser


@pytest.fixture
def screenshots(tmp_path: Path) -> Path:
    """Where pictures of the page go, for somebody to look at."""
    folder = Path(os.environ.get("XORMOCAP_SCREENSHOTS", tmp_path / "screenshots"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder
