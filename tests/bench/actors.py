"""How well `xormocap fit` finds random people: height, bones, heading, from silhouettes with noise.

First from the first frames, in which people stand or begin to walk; then again, as `--refine` does it, from
frames of all of a motion that is tracked with what was found at first.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.later_motion import MOTIONS, going_on, tracked
from bench.random_bodies import FPS, Person, Sex, Stance, Variety, somebody
from services.mocap.body.actor import build_body
from services.mocap.body.bones import BONES as GENERIC
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.shape_space import INDEX, vector_of
from services.mocap.body.skeleton import DOF_INDEX, TRUNK
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import open_engine
from services.mocap.energy.settings import EngineSettings
from services.mocap.fit.fitting import Fit, fit_actor
from services.mocap.search.settings import SearchSettings
from services.mocap.synth.studio import studio_cameras
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Floats
from services.runs.fit_frames import guess_first_pose
from services.runs.refine import DEFAULT_REFINE_FRAMES, LEAST_FRAMES, spread

BONES = (
    "hip_width", "shoulder_width", "trunk", "neck", "head",
    "upper_arm", "forearm", "hand", "thigh", "shank", "foot",
)  # fmt: skip
"""The bones that count. The trunk is pelvis and torso together, from hips to neck: no joint moves between the
two, so that no silhouette tells where one ends."""
HEIGHT_CM, BONE_PERCENT, HEADING_DEG = 1.0, 5.0, 30.0
"""What is asked for."""


@dataclass(frozen=True)
class Found:
    """What a fit found of one person."""

    height_cm: float
    """Found less true."""
    bones_percent: dict[str, float]
    """Bone -> found over true length, less one; pelvis and torso, too, which do not count."""
    joints_mm: float
    """Mean distance of found from true joints, over the frames that were fitted."""
    iou: float
    seconds: float

    @property
    def worst_bone(self) -> str:
        """Of those that count."""
        return max(BONES, key=lambda bone: abs(self.bones_percent[bone]))

    @property
    def is_right(self) -> bool:
        """Whether height and all bones are as asked for."""
        worst = abs(self.bones_percent[self.worst_bone])
        return abs(self.height_cm) <= HEIGHT_CM and worst <= BONE_PERCENT


@dataclass(frozen=True)
class Row:
    """One person."""

    variety: Variety
    number: int
    sex: Sex
    stance: Stance
    height_m: float
    heading_deg: float
    """Between the found and the true heading in the first frame."""
    first: Found
    """From the first frames."""
    motion: str | None
    """What the person went on with, if anything."""
    refined: Found | None
    """From frames of all of that."""

    @property
    def faces_right(self) -> bool:
        """Whether the heading is as asked for."""
        return abs(self.heading_deg) <= HEADING_DEG


@dataclass(frozen=True)
class Trial:
    """What random people are asked to do."""

    variety: Variety
    n_frames: int
    """The first frames."""
    n_later: int
    """Frames of the motion after them; none: nothing is refined."""
    seed: int

    def seed_of(self, number: int) -> int:
        """A person's own."""
        return 1000 * self.seed + number


def measure(trial: Trial, numbers: Sequence[int]) -> Iterator[Row]:
    """Fit one random person after the other, from their silhouettes alone."""
    rig, stances = Rig.of(studio_cameras(8)), list(Stance)
    for number in numbers:
        stance = stances[number % len(stances)]
        person = somebody(rig, trial.variety, stance, trial.n_frames, trial.seed_of(number))
        yield _row(trial, number, rig, person)


def _row(trial: Trial, number: int, rig: Rig, person: Person) -> Row:
    fit, seconds = _first_fit(rig, person)
    off_rad = float((fit.poses - person.poses)[0, DOF_INDEX["root_heading"]])
    motion = MOTIONS[number // len(Stance) % len(MOTIONS)] if trial.n_later else None
    return Row(
        variety=trial.variety,
        number=number,
        sex=person.sex,
        stance=person.stance,
        height_m=round(person.body.standing_height_m, 3),
        heading_deg=round(float(np.degrees((off_rad + np.pi) % (2 * np.pi) - np.pi)), 1),
        first=_found(fit, person, person.poses, seconds),
        motion=motion,
        refined=_refined(trial, rig, person, fit, motion, number) if motion else None,
    )


def _first_fit(rig: Rig, person: Person) -> tuple[Fit, float]:
    """The fit to the first frames, and the seconds that it took."""
    hints = TakeSettings(name="somebody", fps=FPS, units="m", up="z", frames=len(person.poses))
    began_s = time.perf_counter()
    with open_engine(EngineSettings(backend="cpu")) as engine:
        guess = guess_first_pose(rig, person.seen[0], hints, engine, SearchSettings())
    fit = fit_actor(rig, person.seen, guess.actor, guess.solution.pose)
    return fit, time.perf_counter() - began_s


def _refined(trial: Trial, rig: Rig, person: Person, first: Fit, motion: str, number: int) -> Found | None:
    """Track the motion with what was found at first, and fit again as --refine does, if it does."""
    later = going_on(person, rig, motion, trial.n_later, trial.seed_of(number))
    with open_engine(EngineSettings(backend="cpu")) as engine:
        path = tracked(first.actor, first.poses, later.seen, rig, engine)
    began_s = time.perf_counter()
    rows = spread(path.distrusted, DEFAULT_REFINE_FRAMES)
    if len(rows) < LEAST_FRAMES:
        return None
    fit = fit_actor(rig, later.seen[rows], first.actor, path.poses[rows])
    return _found(fit, person, later.poses[rows], time.perf_counter() - began_s)


def _found(fit: Fit, person: Person, true_poses: Floats, seconds: float) -> Found:
    body = build_body(fit.actor)
    joints_m = [joint_positions(p, b.offsets_m) for p, b in ((fit.poses, body), (true_poses, person.body))]
    return Found(
        height_cm=round(100 * (body.standing_height_m - person.body.standing_height_m), 2),
        bones_percent=_bones_percent(vector_of(fit.actor), person.x),
        joints_mm=round(1000 * float(np.linalg.norm(joints_m[0] - joints_m[1], axis=2).mean()), 1),
        iou=round(float(fit.after.iou.mean()), 4),
        seconds=round(seconds, 1),
    )


def _bones_percent(found: Floats, true: Floats) -> dict[str, float]:
    both = [_lengths(x) for x in (found, true)]
    return {bone: round(100 * (both[0][bone] / both[1][bone] - 1), 2) for bone in both[0]}


def _lengths(x: Floats) -> dict[str, float]:
    """Every bone over the generic one of the generic height, of a shape vector."""
    scale = np.exp(x[INDEX["height"]])
    lengths = {bone: float(scale * np.exp(x[INDEX[bone]])) for bone in (*BONES, *TRUNK) if bone in INDEX}
    shares = [GENERIC[bone].length_heights for bone in TRUNK]
    return {**lengths, "trunk": float(np.average([lengths[bone] for bone in TRUNK], weights=shares))}
