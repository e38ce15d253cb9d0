"""Several takes at once with one pool of limb workers: each gets what it would get alone."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from busy import BUSY, ONE_WAY
from one_process import tracked_here

from bench.soak.latency import Stopwatch
from services.mocap.body.actor import Actor
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import write_actor
from services.mocap.take.layout import ACTOR, SETTINGS
from services.mocap.take.settings import read_take_file
from services.runs.launcher import Launcher, free_endpoint

pytestmark = pytest.mark.timeout(560)

_FRAMES = 20


@pytest.fixture(scope="module")
def takes(exact_take: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two takes of the same name and pictures, tracked with bodies of different heights."""
    other = tmp_path_factory.mktemp("other") / "walk"
    shutil.copytree(exact_take, other)
    height_m = read_take_file(other / SETTINGS).actor_height
    assert height_m is not None
    write_actor(other / ACTOR, Actor(height=0.97 * height_m), "a worse one")
    return exact_take, other


class Takes:
    """Takes of _FRAMES frames tracked at once by a coordinator each, with two workers for all of them."""

    def __init__(self, launcher: Launcher, folder: Path, takes: tuple[Path, ...]) -> None:
        self.launcher, self._folder = launcher, folder
        self.endpoints = [free_endpoint() for _ in takes]
        some = ("--frames", f"0:{_FRAMES}", *BUSY, *ONE_WAY)
        for number, (take, endpoint) in enumerate(zip(takes, self.endpoints, strict=True)):
            source, to, out = ("--take", str(take)), ("--connect", endpoint), str(folder / f"out-{number}")
            launcher.start(
                "coordinator", *source, "--bind", endpoint, "--workers", "2", "--recorders", "1", *some
            )
            launcher.start("segmentation", *source, *to)
            launcher.start("recorder", *source, *to, "--out", out, "--no-overlay", "--no-report")
        self.until(lambda: all("recorder@" in log for log in self.coordinator_logs()))
        pool = [word for endpoint in self.endpoints for word in ("--connect", endpoint)]
        launcher.start("limb_worker", *pool, copies=2)  # now all begin at the same time

    def coordinator_logs(self) -> list[str]:
        """In the order of the takes."""
        found = sorted(self._folder.glob("coordinator-*.log"))
        return [log.read_text() for log in found]

    def until(self, condition: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + 150
        while not condition():
            assert time.monotonic() < deadline_s, "it never happened"
            self.launcher.watch()
            time.sleep(0.05)

    def finish(self) -> list[str]:
        """poses.csv of each."""
        self.until(lambda: self.launcher.is_done("recorder"))
        return [(self._folder / f"out-{n}" / "poses.csv").read_text() for n in range(len(self.endpoints))]


@pytest.fixture(scope="module")
def alone(takes: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """poses.csv of each take when nothing else is tracked."""
    search, folder = SearchSettings(search_limbs="always", both_ways=False), tmp_path_factory.mktemp("alone")
    results = [
        tracked_here(take, folder / f"out-{n}", f"0:{_FRAMES}", search) for n, take in enumerate(takes)
    ]
    return [(result / "poses.csv").read_text() for result in results]


def test_two_takes_at_once_are_tracked_as_each_alone_though_one_coordinator_dies(
    takes: tuple[Path, Path], alone: list[str], tmp_path: Path
) -> None:
    assert alone[0] != alone[1]
    with Launcher(tmp_path) as launcher:
        both = Takes(launcher, tmp_path, takes)
        with Stopwatch(both.endpoints[0]) as first, Stopwatch(both.endpoints[1]) as second:
            both.until(lambda: first.frame >= 2 and second.frame >= 2)
            assert max(first.frame, second.frame) < _FRAMES, "neither waited for the other's end"
            os.kill(launcher.pids("coordinator")[0], signal.SIGKILL)
            died_at, lived_at = first.frame, second.frame
            both.until(lambda: first.frame > died_at + 1 and second.frame > lived_at + 1)
        assert both.finish() == alone
    logs = both.coordinator_logs()
    assert "continuing run" in logs[0]
    assert "forgot limb_worker" not in logs[1], "the death of one coordinator is no matter to the other"


def test_one_key_opens_two_coordinators_with_keys_of_their_own(
    exact_take: Path, xormocap: Callable[..., "subprocess.CompletedProcess[str]"], tmp_path: Path
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first, second):
        assert xormocap("keys", "new", folder, "--clients", "segmentation,recorder,pool").returncode == 0
    mine, theirs = first / "pool", second / "pool"
    for name in ("client.key", "client.key_secret"):
        shutil.copy(mine / name, theirs / name)
    shutil.copy(mine / "client.key", second / "coordinator" / "clients" / "pool.key")
    endpoints = [free_endpoint(), free_endpoint()]
    pool = [word for endpoint in endpoints for word in ("--connect", endpoint)]
    with Launcher(tmp_path) as launcher:
        for keys, endpoint in zip((first, second), endpoints, strict=True):
            launcher.start("coordinator", "--take", str(exact_take), "--bind", endpoint, "--keys", str(keys))
        launcher.start("limb_worker", *pool, "--keys", str(mine), "--keys", str(theirs))
        logs = sorted(tmp_path.glob("coordinator-*.log"))
        deadline_s = time.monotonic() + 60
        while not all("limb_worker@" in log.read_text() for log in logs):
            assert time.monotonic() < deadline_s
            launcher.watch()
            time.sleep(0.1)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--connect", "tcp://127.0.0.1:1") * 2, "contains a coordinator twice"),
        (("--keys", "a", "--keys", "b"), "expected one folder, or one for each of 1 coordinators"),
        (("--connect", "tcp://127.0.0.1:1", "--connect", "nonsense"), "expected an address"),
    ],
)
def test_what_a_worker_cannot_be_told(arguments: tuple[str, ...], sentence: str) -> None:
    command = [sys.executable, "-m", "services.limb_worker", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert sentence in done.stderr


def test_the_environment_names_coordinators_and_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XORMOCAP_CONNECT", "tcp://127.0.0.1:1 tcp://127.0.0.1:4 tcp://127.0.0.1:7")
    monkeypatch.setenv("XORMOCAP_KEYS", f"{tmp_path / 'a'}:{tmp_path / 'b'}")
    command = [sys.executable, "-m", "services.limb_worker"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert "one for each of 3 coordinators in their order, got 2" in done.stderr
