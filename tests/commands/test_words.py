"""What the terminal says of a run's numbers: one rate, in the same words everywhere, and what energy is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from services import cli
from services.commands import fitted_runs, live, track
from services.commands.checks import blamed_first
from services.commands.consoles import say
from services.mocap.errors import CertainError, TakeError
from services.mocap.result.words import ENERGY_IN_WORDS
from services.mocap.synth.take import write_synthetic_take
from services.mocap.verdict.verdict import Cause
from services.runs.progress import Progress
from services.runs.track import TakeJob

SPEED = {"frames_per_s": 12.345, "first_frame_s": 0.76, "evaluations_per_frame": 500.0}


def test_a_run_explains_energy_before_its_bar_and_says_its_rate_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def tracked(
        job: TakeJob, show: Callable[[Progress], None], warn: Callable[[str], None]
    ) -> dict[str, Any]:
        show(Progress(3, True, 9.87, 900.0, "tracking", None))
        warn("a remark")
        return {"take": {"frames": len(job.frames)}, "speed": SPEED}

    monkeypatch.setattr(fitted_runs, "track_take", tracked)
    monkeypatch.setattr(track, "conclude", lambda *_, **__: None)
    write_synthetic_take(tmp_path / "walk", n_frames=3, n_cameras=2)
    words = ["track", tmp_path / "walk", "--out", tmp_path / "out", "--no-fit", "--no-check"]
    done = CliRunner().invoke(cli.app, list(map(str, words)), catch_exceptions=False)
    before, explained, after = done.stderr.partition(ENERGY_IN_WORDS)
    assert explained and ENERGY_IN_WORDS not in after
    assert "energy 900 px" in after and "energy" not in before
    assert "fps" not in done.output and "9.9" not in done.output, "the bar's rate would be another one"
    rows = [" ".join(line.split()) for line in done.stdout.splitlines()]
    assert "tracked at 12.3 frames per second, after 0.8 s for the first" in rows


def test_a_live_run_says_its_rate_in_the_same_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_run = {"latency_s": {"median": 0.03, "p95": 0.05}, "shots": {"solved": 9, "first": 0, "last": 9}}
    report = {"take": {"fps": 14.96}, "speed": SPEED, "live": {**of_run, "abreast": None}}
    live._summarise(report, tmp_path, None)
    rows = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "tracked at 15.0 frames per second" in rows


def test_checks_are_blamed_before_an_error_unless_its_reason_is_certain() -> None:
    check = Cause(what="background/: is missing", remedy="record it", level="good")
    with pytest.raises(TakeError) as refused, blamed_first([check]):
        raise TakeError("silhouettes: nobody is visible")
    assert str(refused.value) == f"{check}; this led to: silhouettes: nobody is visible"
    with pytest.raises(CertainError) as refused, blamed_first([check]):
        raise CertainError("silhouettes: are white")
    assert str(refused.value) == "silhouettes: are white"
    with pytest.raises(TakeError, match=r"^nobody$"), blamed_first([]):
        raise TakeError("nobody")


def test_paths_with_colons_are_printed_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    say("vids :x:/cam01.mp4: expected --frames 0:100:")
    assert capsys.readouterr().out == "vids :x:/cam01.mp4: expected --frames 0:100:\n"
