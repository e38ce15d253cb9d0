"""`xormocap status` tells of a run, before it begins, while it goes on and when nobody is there."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

from bench.soak.latency import Stopwatch
from patience import until
from services.commands.status import answer_of
from services.runs.launcher import Launcher, free_endpoint

pytestmark = pytest.mark.timeout(280)
Command = Callable[..., "subprocess.CompletedProcess[str]"]


def told(xormocap: Command, endpoint: str) -> dict[str, Any]:
    done = xormocap("status", "--connect", endpoint, "--json")
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def test_a_run_from_its_beginning_to_its_end(exact_take: Path, xormocap: Command, tmp_path: Path) -> None:
    take, out, endpoint = ("--take", str(exact_take)), tmp_path / "out", free_endpoint()
    connect, clients = ("--connect", endpoint), ("--workers", "1", "--recorders", "1")
    with Launcher(tmp_path) as launcher:
        port = int(endpoint.rpartition(":")[2]) + 3
        options = ("--search", "paper", *clients, "--metrics", str(port))
        launcher.start("coordinator", *take, "--bind", endpoint, *options)
        launcher.start("limb_worker", *connect)
        until(lambda: answer_of(endpoint) == "listens", timeout_s=150)
        before = told(xormocap, endpoint)
        assert (before["take"], before["stage"], before["run"]) == ("walk", "waiting for clients", "")
        assert (before["next_frame"], before["end_frame"], before["recorders"]) == (0, 24, {})

        live = subprocess.Popen(
            [sys.executable, "-m", "services.cli", "status", *connect],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        launcher.start("recorder", *take, *connect, "--out", str(out), "--no-overlay", "--no-report")
        with Stopwatch(endpoint) as stopwatch:
            launcher.start("segmentation", *take, *connect)
            until(lambda: stopwatch.frame >= 2, timeout_s=150)
            os.kill(
                launcher.pids("segmentation")[0], signal.SIGSTOP
            )  # so that the run does not end meanwhile
        answer = told(xormocap, endpoint)
        assert answer["stage"] == "tracking"
        assert len(answer["run"]) == 32
        assert list(answer["workers"].values()) == ["cpu"]
        assert list(answer["limbs"]) in ([], list(answer["workers"]))
        assert len(answer["recorders"]) == 1
        assert answer["seconds"]["frame"] > 0
        assert answer["counts"]["malformed"] == 0

        shown = xormocap("status", *connect, "--once")
        assert shown.returncode == 0, shown.stderr
        assert "limb_worker" in shown.stdout
        assert "of 24 frames" in shown.stdout

        with urlopen(f"http://127.0.0.1:{port}/metrics") as figures:
            told_there = figures.read().decode()
        for name in (
            "frames_solved_total",
            "task_retries_total ",
            'stage_seconds_sum{stage="limbs"}',
            "workers 1",
        ):
            assert f"xormocap_{name}" in told_there

        os.kill(launcher.pids("segmentation")[0], signal.SIGCONT)
        until(lambda: launcher.is_done("recorder"), timeout_s=150)
        said, _ = live.communicate(timeout=60)
        assert live.returncode == 0, said
        assert "24 of 24 frames" in said


def test_nobody_is_there(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A refused connection is told at once, however long a silent host is waited for."""
    monkeypatch.setattr("services.commands.status._REACHED_S", 60.0)
    began_s = time.monotonic()
    said = refused("status", "--connect", free_endpoint(), "--once")
    assert time.monotonic() - began_s < 3
    assert "no run answers there: start one by xormocap track TAKE --endpoint" in said


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [(("--connect", "nonsense"), "expected an address"), (("--keys", "/nowhere"), "/nowhere")],
)
def test_what_cannot_be(refused: Callable[..., str], arguments: tuple[str, ...], sentence: str) -> None:
    assert sentence in refused("status", *arguments)
