"""How commands that track end: the lines of the verdict, and the exit code of `--strict`."""

import json
import shutil
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
import typer

from services.commands.view import EXIT_NOT_USABLE, conclude, view
from services.mocap.result.frame_files import write_frame_file
from services.mocap.take.marks import PARTS


@pytest.fixture
def folder(bare_result: Path, tmp_path: Path) -> Path:
    """16 frames, in one of which the left arm is doubtful."""
    return Path(shutil.copytree(bare_result, tmp_path / "mine"))


def overlapping(folder: Path, iou: float) -> None:
    """Give a result this overlap in three cameras, and less in the last one."""
    part_px = {part: np.full(16, 50.0) for part in PARTS}
    known = {"cam01": np.full(16, iou), "cam02": np.full(16, iou), "cam03": np.full(16, iou - 0.01)}
    frames = np.arange(100, 116, dtype=np.int32)
    write_frame_file(folder / "energies.csv", frames, {"part_px": part_px, "iou": known})
    (folder / "run.json").write_text(json.dumps({"take": {"name": "walk", "folder": "my-take"}}))


def test_results_that_are_not_usable_end_in_exit_code_3_where_that_is_asked_for(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    overlapping(folder, 0.5)
    with pytest.raises(typer.Exit) as ended:
        conclude(folder, None, None, strict=True)
    assert ended.value.exit_code == EXIT_NOT_USABLE == 3
    verdict, doubtful, overlap, cause = capsys.readouterr().out.splitlines()
    assert verdict == "verdict: not usable: 1 of 16 frames has doubtful parts"
    assert doubtful == "  doubtful: left arm in 1 (frame 103)"
    assert overlap.startswith(
        "  overlap of body and silhouettes: 0.50, lowest in cam03: 0.49 (IoU, intersection"
    )
    assert cause.startswith("  cause: body and silhouettes overlap little in most cameras (IoU 0.50")
    assert cause.endswith("run xormocap calibrate --check my-take")
    conclude(folder, None, None, strict=False)


def test_results_with_gaps_are_usable(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    overlapping(folder, 0.9)
    conclude(folder, None, None, strict=True)
    assert capsys.readouterr().out.startswith(
        "verdict: usable with gaps: 1 of 16 frames has doubtful parts\n"
    )


def test_the_terminal_says_why_the_page_has_no_pictures(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    overlapping(folder, 0.9)
    monkeypatch.setattr("services.viewer.server.PageServer", MagicMock())
    monkeypatch.setattr("services.commands.view.StopRequest", MagicMock())  # its count is true at once
    view(folder)
    said = " ".join(capsys.readouterr().err.split())
    assert said == "warning: The take is not at my-take any more: give --take to see its cameras."
