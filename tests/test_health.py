"""A service touches a file, and the probe looks how old it is."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from services import health
from services.health import HUNG_AFTER_S, beat, heartbeat


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "health"
    monkeypatch.setenv(health.VARIABLE, str(path))
    return path


def probe() -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "services.health"], capture_output=True, text=True, timeout=30, check=False
    )


@pytest.mark.parametrize(
    ("silent_s", "state"), [(None, "starting"), (0.0, "working"), (HUNG_AFTER_S + 1, "hung")]
)
def test_a_service_says_how_it_is(path: Path, silent_s: float | None, state: str) -> None:
    with heartbeat("recorder"):
        for _ in range(0 if silent_s is None else 3):
            beat()
        if silent_s:
            os.utime(path, (time.time() - silent_s,) * 2)  # noqa: TID251  (the clock of files' times)
        asked = probe()
    answer = json.loads(asked.stdout)
    assert (answer["service"], answer["state"]) == ("recorder", state)
    assert asked.returncode == (0 if state == "working" else 1)


def test_a_loop_that_comes_round_again_is_working(path: Path) -> None:
    with heartbeat("recorder"):
        beat()
        os.utime(path, (1.0, 1.0))
        assert probe().returncode == 1
        beat()
        assert probe().returncode == 0


def test_nobody_there(path: Path) -> None:
    with heartbeat("recorder"):
        beat()
    asked = probe()
    assert asked.returncode == 1
    assert str(path) in asked.stderr


def test_a_service_that_died_leaves_its_place_to_the_next(path: Path) -> None:
    path.write_text("left behind")
    with heartbeat("recorder"):
        answer = json.loads(probe().stdout)
    assert (answer["service"], answer["state"]) == ("recorder", "starting")


def test_a_place_that_cannot_be_written_is_told_at_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(health.VARIABLE, "/nowhere/health")
    with pytest.raises(OSError, match="/nowhere/health"), heartbeat("recorder"):
        pass


def test_without_a_word_nothing_is_touched(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(health.VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    with heartbeat("recorder"):
        beat()
    assert not list(tmp_path.iterdir())
    monkeypatch.chdir(Path(health.__file__).parents[1])
    asked = probe()
    assert asked.returncode == 1
    assert health.VARIABLE in asked.stderr


def test_the_probe_imports_little() -> None:
    heavy = {"numpy", "cv2", "numba", "pydantic", "zmq"}
    program = f"import sys, services.health; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
