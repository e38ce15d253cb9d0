"""A backend that does not know a cost is refused where the options are read, before anything is started."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

OPTIONS = ("--backend", "paper", "--set", "camera_weights=[1.0, 0.5]")


@pytest.mark.parametrize("command", ["track", "coordinator"])
def test_costs_that_paper_does_not_know_are_refused(
    small_take: Callable[..., Path], tmp_path: Path, command: str
) -> None:
    take, out = str(small_take()), tmp_path / "out"
    words = {
        "track": ("services.cli", "track", take, "--out", str(out)),
        "coordinator": ("services.coordinator", "--take", take),
    }[command]
    done = subprocess.run(
        [sys.executable, "-m", *words, *OPTIONS], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "--backend paper: counts differing pixels and knows only the camera_weights 0 and 1: leave that "
        "setting out, or choose another backend"
    ]
    assert not out.exists()
