"""Services with keys, as processes: the right key works, and a wrong, a revoked or no key never gets in."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from busy import BUSY, ONE_WAY, SHORT

from patience import until
from services.runs.launcher import Launcher, free_endpoint

pytestmark = pytest.mark.timeout(280)

_SOME = "14:20"
_BARE = ("--no-overlay", "--no-report")
_QUICK = ("--frames", "0:1", "--workers", 0, *SHORT)


class Run:
    """A run whose services are started one by one; logs by service, in the order of their start."""

    def __init__(self, launcher: Launcher, logs: Path, take: Path, keys: Path) -> None:
        self.launcher, self._logs, self._take, self._keys = launcher, logs, ("--take", str(take)), keys
        self.endpoint, self.out = free_endpoint(), logs / "out"
        self._started = 0

    def start(self, name: str, *arguments: object, keys: Path | None = None) -> Callable[[], str]:
        """Start a service; returns what reads its log. keys: else those of its role."""
        log = self._logs / f"{name}-{self._started}.log"
        self._started += 1
        self.launcher.start(name, *map(str, arguments), "--keys", str(keys or self._keys))
        return log.read_text

    def start_all(self, workers: int, frames: str = _SOME) -> Callable[[], str]:
        """Coordinator, segmentation and recorder; returns what reads the coordinator's log."""
        expected = ("--frames", frames, "--workers", workers, "--recorders", 1, *BUSY, *ONE_WAY)
        log = self.start("coordinator", *self._take, "--bind", self.endpoint, *expected)
        self.start("segmentation", *self._take, "--connect", self.endpoint)
        self.start("recorder", *self._take, "--connect", self.endpoint, "--out", self.out, *_BARE)
        return log

    def start_worker(self, keys: Path | None = None) -> Callable[[], str]:
        return self.start("limb_worker", "--connect", self.endpoint, keys=keys)

    def finish(self, timeout_s: float = 150) -> None:
        self.until(lambda: self.launcher.has_ended("recorder"), timeout_s)

    def until(self, true: Callable[[], bool], timeout_s: float = 60) -> None:
        deadline_s = time.monotonic() + timeout_s
        while not true():
            assert time.monotonic() < deadline_s, "it never happened"
            self.launcher.watch()
            time.sleep(0.05)

    def poses(self) -> list[str]:
        return (self.out / "poses.csv").read_text().splitlines()


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory, xormocap) -> Path:
    folder = tmp_path_factory.mktemp("keys") / "keys"
    assert xormocap("keys", "new", folder).returncode == 0
    assert xormocap("keys", "add", folder, "second-worker").returncode == 0
    return folder


@pytest.fixture
def run(synthetic_take: Path, tmp_path: Path, keys: Path):
    shutil.copytree(keys, tmp_path / "keys")
    with Launcher(tmp_path) as launcher:
        yield Run(launcher, tmp_path, synthetic_take, tmp_path / "keys")


@pytest.fixture
def other_keys(tmp_path: Path, xormocap) -> Path:
    """Keys of another coordinator and its clients."""
    assert xormocap("keys", "new", tmp_path / "other").returncode == 0
    return tmp_path / "other"


def test_a_run_with_keys_finds_what_one_without_finds(run: Run, one_way: Path) -> None:
    log = run.start_all(workers=2)
    for _ in range(2):
        run.start_worker()
    run.finish()
    run.until(lambda: "end: " in log())
    assert run.poses() == (one_way / "poses.csv").read_text().splitlines()
    assert len(run.poses()) == 7
    assert "'unwelcome': 0, 'handshakes_failed': 0" in log()
    assert "Traceback" not in log()


def test_who_has_no_right_key_never_gets_in(
    run: Run, one_way: Path, keys: Path, other_keys: Path, tmp_path: Path
) -> None:
    unknown, misled = tmp_path / "unknown", tmp_path / "misled"
    shutil.copytree(other_keys / "limb_worker", unknown)
    shutil.copy(keys / "coordinator" / "server.key", unknown)
    shutil.copytree(keys / "limb_worker", misled)
    shutil.copy(other_keys / "coordinator" / "server.key", misled)
    coordinator = run.start_all(workers=1)
    logs = [run.start_worker(unknown), run.start_worker(misled)]
    run.launcher.start("limb_worker", "--connect", run.endpoint)
    keyless_log = tmp_path / "limb_worker-5.log"
    run.until(lambda: "the coordinator requires keys: give --keys DIR" in keyless_log.read_text())
    told = ("is not on the list in", "server.key is not this coordinator's", "a client without keys")
    run.until(lambda: all(sentence in coordinator() for sentence in told))
    run.start_worker()  # not before: with it the run may be over before the others come
    *strangers, friend = run.launcher.pids("limb_worker")
    run.until(lambda: "refuses this service's key" in logs[0]())
    run.until(lambda: "is not this coordinator's" in logs[1]())
    run.finish()
    run.until(lambda: "end: " in coordinator())
    assert f":{friend} says hello" in coordinator()
    for pid in strangers:
        assert f":{pid} " not in coordinator()
    for sentence in told:
        assert coordinator().count(f"{sentence}") in (1, 2, 3)  # once a stream, or once at all
    assert "'handshakes_failed': 0" not in coordinator()
    assert "'unwelcome': 0" in coordinator()
    assert run.poses() == (one_way / "poses.csv").read_text().splitlines()
    assert len(run.poses()) == 7


def test_a_worker_that_is_revoked_in_mid_take_gets_no_further_task(
    run: Run, one_way: Path, tmp_path: Path
) -> None:
    own = tmp_path / "second"
    shutil.copytree(tmp_path / "keys" / "second-worker", own)
    coordinator = run.start_all(workers=2, frames="14:20")
    run.start_worker()
    revoked = run.start_worker(own)
    pid = run.launcher.pids("limb_worker")[-1]
    run.until(lambda: coordinator().count("says hello") >= 3)
    time.sleep(0.5)  # by now both solve limbs of the first frame, which takes a second or two
    assert "the actor faces" not in coordinator()
    (tmp_path / "keys" / "coordinator" / "clients" / "second-worker.key").unlink()
    after = len(coordinator())
    os.kill(run.launcher.pids("coordinator")[0], signal.SIGHUP)
    run.until(lambda: "revoked: second-worker" in coordinator(), 5)
    run.finish()
    run.until(lambda: "end: " in coordinator())
    assert f":{pid}: connection lost" in coordinator()[after:]
    assert f":{pid} says hello" not in coordinator()[after:]
    assert "Traceback" not in coordinator() + revoked()
    assert run.poses() == (one_way / "poses.csv").read_text().splitlines()


@pytest.fixture
def young_coordinator(synthetic_take: Path) -> Callable[..., "subprocess.Popen[str]"]:
    """Starts a coordinator, and returns once it has begun to load and no handler is there yet."""

    def start(*arguments: object) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", "services.coordinator", "--take", str(synthetic_take)]
        process = subprocess.Popen(
            [*command, "--bind", free_endpoint(), *map(str, arguments)], stderr=subprocess.PIPE, text=True
        )
        status, deadline_s = Path(f"/proc/{process.pid}/status"), time.monotonic() + 20
        while not _ignores(status.read_text(), signal.SIGHUP):
            assert time.monotonic() < deadline_s
        return process

    return start


def _ignores(status: str, number: signal.Signals) -> bool:
    """Whether a process ignores a signal, as the kernel tells of it."""
    mask = next(line.split()[1] for line in status.splitlines() if line.startswith("SigIgn"))
    return bool(int(mask, 16) >> (number - 1) & 1)


def test_a_change_of_the_list_that_is_told_before_anybody_listens_counts(
    young_coordinator: Callable[..., "subprocess.Popen[str]"], keys: Path
) -> None:
    process = young_coordinator("--keys", keys)
    process.send_signal(signal.SIGHUP)
    said = ""
    assert process.stderr is not None
    while "read the list of clients again" not in said:
        line = process.stderr.readline()
        assert line, f"it has ended with {process.wait()}: {said}"
        said += line
    process.send_signal(signal.SIGHUP)
    time.sleep(0.5)
    process.terminate()
    assert said.count("read the list") + process.communicate(timeout=60)[1].count("read the list") == 2


@pytest.mark.skipif(
    signal.getsignal(signal.SIGHUP) is signal.SIG_IGN,
    reason="whoever started the tests ignores hangups, so all do",
)
def test_without_keys_a_hangup_ends_a_coordinator_as_it_ends_others(
    young_coordinator: Callable[..., "subprocess.Popen[str]"],
) -> None:
    process = young_coordinator()
    status = Path(f"/proc/{process.pid}/status")
    until(lambda: not _ignores(status.read_text(), signal.SIGHUP))
    process.send_signal(signal.SIGHUP)
    assert process.wait(60) == -signal.SIGHUP


@pytest.mark.parametrize("service", ["coordinator", "limb_worker"])
def test_beyond_this_machine_nothing_starts_without_keys(service: str, synthetic_take: Path) -> None:
    role = {
        "coordinator": ["--take", str(synthetic_take), "--bind", "tcp://0.0.0.0:5550"],
        "limb_worker": ["--connect", "tcp://192.0.2.1:5550"],
    }
    command = [sys.executable, "-m", f"services.{service}", *role[service]]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert done.stderr.strip().splitlines()[-1].startswith(f"tcp://{role[service][-1][6:-5]}")
    assert "--keys DIR" in done.stderr


def test_keys_that_are_missing_are_one_sentence(synthetic_take: Path, tmp_path: Path) -> None:
    arguments = ["--take", str(synthetic_take), "--keys", str(tmp_path)]
    command = [sys.executable, "-m", "services.coordinator", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(
        f"{tmp_path}: expected the keys server.key_secret, there or in coordinator/: make"
    )
    assert len(done.stderr.splitlines()) == 1


def test_the_environment_gives_keys_to_services_and_not_to_track(
    exact_take: Path, tmp_path: Path, xormocap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XORMOCAP_KEYS", str(tmp_path / "nowhere"))
    command = [sys.executable, "-m", "services.limb_worker"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "nowhere: expected the keys" in done.stderr
    tracked = xormocap("track", exact_take, "--out", tmp_path / "out", *_QUICK)
    assert tracked.returncode == 0, tracked.stderr
