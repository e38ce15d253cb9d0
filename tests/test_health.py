"""What a service says of itself, and the probe that asks it."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from services import health
from services.health import SILENCE_S, answering, ask


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
    ("silent_s", "state"), [(None, "starting"), (0.0, "working"), (SILENCE_S + 1, "hung")]
)
def test_a_service_says_how_it_is(path: Path, silent_s: float | None, state: str) -> None:
    with answering("recorder", lambda: None if silent_s is None else time.monotonic() - silent_s):
        for _ in range(3):
            answer = ask(path)
            assert (answer["service"], answer["state"]) == ("recorder", state)
        asked = probe()
    assert json.loads(asked.stdout)["state"] == state
    assert asked.returncode == (0 if state == "working" else 1)


def test_nobody_there(path: Path) -> None:
    with pytest.raises(TimeoutError, match="no service answers there"):
        ask(path)
    asked = probe()
    assert asked.returncode == 1
    assert str(path) in asked.stderr


def test_a_service_that_died_leaves_its_place_to_the_next(path: Path) -> None:
    path.write_text("left behind")
    with answering("recorder", lambda: None):
        assert ask(path)["service"] == "recorder"


def test_without_a_word_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(health.VARIABLE, raising=False)
    with answering("recorder", lambda: None):
        pass
    asked = probe()
    assert asked.returncode == 1
    assert health.VARIABLE in asked.stderr


def test_the_probe_imports_little() -> None:
    heavy = "import sys, services.health; print({'numpy', 'cv2', 'numba', 'pydantic'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
