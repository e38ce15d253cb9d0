"""How well people who are not the body model are fitted and tracked, and how much of it the search owes.

The takes have the truth beside them, as tools that make synthetic people write it (bench.studio_takes).
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.command import Run, track
from bench.limb_scores import (
    Errors,
    MarkErrors,
    bones_off_percent,
    errors_of,
    limb_confidence,
    limb_errors_mm,
    mark_errors_of,
    marked_limbs,
)
from bench.pose_floor import Floor, floor_of
from bench.reliability import Counted, reliability_of
from bench.studio_takes import TrueActor, true_actor, with_true_silhouettes
from services.mocap.errors import TakeError, UserError
from services.mocap.result.layout import JOINTS
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import REFERENCE_JOINTS_CSV
from services.mocap.take.tables import from_take_world, read_joints_csv
from services.mocap.types import Floats
from services.runs.refine import spread


@dataclass(frozen=True)
class Trial:
    """How takes are tracked."""

    workers: int
    options: tuple[str, ...]
    """Further ones of xormocap track."""
    true_silhouettes: bool
    """Instead of what is made of videos, where a take has them."""
    floor_frames: int
    """Frames of a take in which the floor is found, at most; 0: none."""
    results: Path | None
    """Where the results are kept, in a folder for each take."""


@dataclass(frozen=True)
class Outcome:
    """What came of tracking a take."""

    errors: Errors
    """Of joints.csv, as a user gets it."""
    marks: MarkErrors
    bones_off_percent: dict[str, float]
    """Bone -> found over true length, less one."""
    height_off_cm: float
    """Found less true."""
    frames_per_s: float
    reliability: dict[str, Counted]

    @property
    def mean_bone_percent(self) -> float:
        """Without signs."""
        return float(np.mean(np.abs(list(self.bones_off_percent.values())))) if self.worst_bone else np.nan

    @property
    def worst_bone(self) -> str:
        """Empty where no true length is known."""
        return max(
            self.bones_off_percent, key=lambda bone: abs(self.bones_off_percent[bone]), default=""
        )


@dataclass(frozen=True)
class Row:
    """One take."""

    take: str
    cameras: int
    clothes: str
    frames: int
    refusal: str = ""
    """Why it could not be tracked, in the command's own words."""
    outcome: Outcome | None = None
    floor: Floor | None = None


@dataclass(frozen=True, eq=False)
class _Truth:
    actor: TrueActor
    joints_m: Floats = field(repr=False)
    """(F, 15, 3) of all frames of the take, in its own world."""


def measure(folder: Path, trial: Trial) -> Iterator[Row]:
    """Track a take, as a user does, and compare; raises UserError for takes that cannot be used."""
    with tempfile.TemporaryDirectory(prefix="xormocap-bench-") as temporary:
        scratch, name = Path(temporary), folder.resolve().name
        used = with_true_silhouettes(folder, scratch / name) if trial.true_silhouettes else folder
        take, out = open_take(used), (trial.results or scratch / "results") / name
        truth = _truth_of(take)
        row = Row(name, len(take.cameras), truth.actor.clothes, take.settings.frames)
        try:
            run = track(used, out, ":", trial.workers, trial.options)
        except UserError as error:
            yield Row(row.take, row.cameras, row.clothes, row.frames, refusal=str(error))
            return
        outcome = outcome_of(run, read_joints_csv(out / JOINTS).joints_take_m, truth.actor, truth.joints_m)
        floor = _floor(take, run, truth, trial.floor_frames) if trial.floor_frames else None
        yield Row(row.take, row.cameras, row.clothes, row.frames, "", outcome, floor)


def outcome_of(run: Run, found_m: Floats, actor: TrueActor, true_m: Floats) -> Outcome:
    """Compare a run, and its joints.csv (F, 15, 3) in metres, with the truth."""
    found_mm, true_mm = 1000.0 * found_m, 1000.0 * true_m
    limbs_mm, marks, n_frames = limb_errors_mm(found_mm, true_mm), run.poses.marks, len(found_m)
    marked = marked_limbs(marks, n_frames)
    return Outcome(
        errors=errors_of(found_mm, true_mm),
        marks=mark_errors_of(limbs_mm, marked),
        bones_off_percent=bones_off_percent(found_mm, actor.bone_lengths_m),
        height_off_cm=100.0 * (run.actor.height - actor.height_m),
        frames_per_s=run.report["speed"]["frames_per_s"],
        reliability=reliability_of(limbs_mm, marked, limb_confidence(marks, n_frames)),
    )


def _truth_of(take: Take) -> _Truth:
    table = read_joints_csv(take.folder / REFERENCE_JOINTS_CSV)
    if not np.array_equal(table.frames, np.arange(take.settings.frames)):
        raise TakeError(f"{take.folder / REFERENCE_JOINTS_CSV}: frame: expected all frames of the take")
    return _Truth(true_actor(take.folder), table.joints_take_m)


def _floor(take: Take, run: Run, truth: _Truth, n_frames: int) -> Floor:
    rows = spread(np.zeros(take.settings.frames, bool), n_frames)
    true_m = from_take_world(truth.joints_m[rows], take.settings.up)
    return floor_of(take, run.actor, rows.tolist(), run.poses.poses[rows], true_m)
