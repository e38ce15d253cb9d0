"""The `xormocap` command as a user runs it, and what a run of `xormocap track` left behind."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from services.mocap.body.actor import Actor
from services.mocap.errors import UserError
from services.mocap.take.actor_file import read_actor
from services.mocap.take.tables import PoseTable, read_poses_csv


def xormocap(*arguments: object) -> None:
    """Run the command to its end; raises UserError with its own sentence where it fails."""
    words = [str(argument) for argument in arguments]
    command = [sys.executable, "-m", "services.cli", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = [line.strip(" │") for line in done.stderr.splitlines() if line.strip(" │─╭╮╰╯")]
        raise UserError(f"xormocap {words[0]}: {said[-1] if said else f'ended with code {done.returncode}'}")


@dataclass(frozen=True, eq=False)
class Run:
    """The results of one take."""

    report: dict[str, Any]
    """run.json."""
    actor: Actor
    poses: PoseTable
    """As tracked, before any smoothing."""

    @property
    def silently_wrong_frames(self) -> int:
        """Frames in which a joint is far off and nothing says that it should not be trusted."""
        marks = self.poses.marks
        marked = set() if marks is None else set(self.poses.frames[marks.distrusted.any(axis=1)].tolist())
        wrong = {lost["frame"] for lost in self.report.get("accuracy", {}).get("lost_limbs", [])}
        return len(wrong - marked)


def track(take: Path, out: Path, frames: str, workers: int, options: tuple[str, ...]) -> Run:
    """Track frames A:B of a take by real processes; raises UserError."""
    common = ("--out", out, "--frames", frames, "--workers", workers, "--no-overlay")
    xormocap("track", take, *common, *options)
    report = json.loads((out / "run.json").read_text(encoding="utf-8"))
    return Run(report, read_actor(out / "actor.toml"), read_poses_csv(out / "poses.csv"))


def frame_numbers(run: Run) -> range:
    """The frames that were tracked, which are consecutive."""
    numbers = np.asarray(run.poses.frames)
    return range(int(numbers[0]), int(numbers[-1]) + 1)
