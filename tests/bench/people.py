"""How well people who are not the body model are fitted and tracked, and how much of it the search owes.

The takes have the truth beside them, as tools that make synthetic people write it (bench.studio_takes).
"""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
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
        off = self.bones_off_percent
        return max(off, key=lambda bone: abs(off[bone]), default="")


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


def measure(folder_of: Callable[[], Path], trial: Trial) -> Iterator[Row]:
    """Track a take, as a user does, and compare it with the truth: one row.

    folder_of: finds the take's folder, or makes it. Raises UserError for takes that cannot be used.
    """
    folder = folder_of()
    with tempfile.TemporaryDirectory(prefix="xormocap-bench-") as temporary:
        scratch, name = Path(temporary), folder.absolute().name  # a link tells folders of one name apart
        used = with_true_silhouettes(folder, scratch / name) if trial.true_silhouettes else folder
        take, out = open_take(used), (trial.results or scratch / "results") / name
        actor, true_m = true_actor(used), true_joints_m(take)
        row = Row(name, len(take.cameras), actor.clothes, take.settings.frames)
        try:
            run = track(used, out, ":", trial.workers, trial.options)
        except UserError as error:
            yield replace(row, refusal=str(error))
            return
        true_m = true_m[run.poses.frames]  # tracking begins where the actor is in view
        outcome = outcome_of(run, read_joints_csv(out / JOINTS).joints_take_m, actor, true_m)
        floor = _floor(take, run, true_m, trial.floor_frames) if trial.floor_frames else None
        yield replace(row, outcome=outcome, floor=floor)


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


def true_joints_m(take: Take) -> Floats:
    """(F, 15, 3) of all frames, in the take's world."""
    path = take.folder / REFERENCE_JOINTS_CSV
    table = read_joints_csv(path)
    if not np.array_equal(table.frames, np.arange(take.settings.frames)):
        raise TakeError(f"{path}: frame: expected all {take.settings.frames} frames of the take")
    return table.joints_take_m


def _floor(take: Take, run: Run, true_m: Floats, n_frames: int) -> Floor:
    """true_m: (F, 15, 3) of the tracked frames, in the take's world."""
    rows, up = spread(np.zeros(len(true_m), bool), n_frames), take.settings.up
    frames = run.poses.frames[rows].tolist()
    return floor_of(take, run.actor, frames, run.poses.poses[rows], from_take_world(true_m[rows], up))
