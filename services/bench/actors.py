"""How well `xormocap fit` finds random people: height, bones, heading, from silhouettes with noise."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from services.bench.people import FPS, Person, Sex, Stance, Variety, somebody
from services.mocap.body.actor import build_body
from services.mocap.body.bones import BONES as GENERIC
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.shape_space import INDEX, vector_of
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import open_engine
from services.mocap.energy.settings import EngineSettings
from services.mocap.fit.fitting import fit_actor
from services.mocap.search.settings import SearchSettings
from services.mocap.synth.studio import studio_cameras
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Floats
from services.runs.fit import guess_first_pose

BONES = (
    "hip_width", "shoulder_width", "trunk", "neck", "head",
    "upper_arm", "forearm", "hand", "thigh", "shank", "foot",
)  # fmt: skip
"""The bones that count. The trunk is pelvis and torso together, from hips to neck: no joint moves between the
two, so that no silhouette tells where one ends."""
HEIGHT_CM, BONE_PERCENT, HEADING_DEG = 1.0, 5.0, 30.0
"""What is asked for."""
_TRUNK = ("pelvis", "torso")


@dataclass(frozen=True)
class Row:
    """One person."""

    variety: Variety
    number: int
    sex: Sex
    stance: Stance
    height_m: float
    height_cm: float
    """Found less true."""
    bones_percent: dict[str, float]
    """Bone -> found over true length, less one; pelvis and torso, too, which do not count."""
    heading_deg: float
    """Between the found and the true heading in the first frame."""
    joints_mm: float
    """Mean distance of found from true joints, over the frames."""
    iou: float
    seconds: float

    @property
    def worst_bone(self) -> str:
        """Of those that count."""
        return max(BONES, key=lambda bone: abs(self.bones_percent[bone]))

    @property
    def is_found(self) -> bool:
        """Whether height and all bones are as asked for."""
        worst = abs(self.bones_percent[self.worst_bone])
        return abs(self.height_cm) <= HEIGHT_CM and worst <= BONE_PERCENT

    @property
    def faces_right(self) -> bool:
        """Whether the heading is as asked for."""
        return abs(self.heading_deg) <= HEADING_DEG


def measure(variety: Variety, numbers: Sequence[int], n_frames: int, seed: int) -> Iterator[Row]:
    """Fit one random person after the other, from their silhouettes alone."""
    rig, stances = Rig.of(studio_cameras(8)), list(Stance)
    for number in numbers:
        person = somebody(rig, variety, stances[number % len(stances)], n_frames, 1000 * seed + number)
        yield _row(variety, number, rig, person)


def _row(variety: Variety, number: int, rig: Rig, person: Person) -> Row:
    hints = TakeSettings(name="somebody", fps=FPS, units="m", up="z", frames=len(person.poses))
    began_s = time.perf_counter()
    with open_engine(EngineSettings(backend="cpu")) as engine:
        guess = guess_first_pose(rig, person.silhouettes[0], hints, engine, SearchSettings())
    fit = fit_actor(rig, person.silhouettes, guess.actor, guess.solution.pose)
    seconds = time.perf_counter() - began_s
    body, heading = build_body(fit.actor), DOF_INDEX["root_heading"]
    off_rad = float(fit.poses[0, heading] - person.poses[0, heading])
    joints_m = [joint_positions(p, b.offsets_m) for p, b in ((fit.poses, body), (person.poses, person.body))]
    return Row(
        variety=variety,
        number=number,
        sex=person.sex,
        stance=person.stance,
        height_m=round(person.body.standing_height_m, 3),
        height_cm=round(100 * (body.standing_height_m - person.body.standing_height_m), 2),
        bones_percent=_bones_percent(vector_of(fit.actor), person.x),
        heading_deg=round(float(np.degrees((off_rad + np.pi) % (2 * np.pi) - np.pi)), 1),
        joints_mm=round(1000 * float(np.linalg.norm(joints_m[0] - joints_m[1], axis=2).mean()), 1),
        iou=round(fit.after.mean_iou, 4),
        seconds=round(seconds, 1),
    )


def _bones_percent(found: Floats, true: Floats) -> dict[str, float]:
    both = [_lengths(x) for x in (found, true)]
    return {bone: round(100 * (both[0][bone] / both[1][bone] - 1), 2) for bone in both[0]}


def _lengths(x: Floats) -> dict[str, float]:
    """Every bone over the generic one of the generic height, of a shape vector."""
    scale = np.exp(x[INDEX["height"]])
    lengths = {bone: float(scale * np.exp(x[INDEX[bone]])) for bone in (*BONES, *_TRUNK) if bone in INDEX}
    shares = [GENERIC[bone].length_heights for bone in _TRUNK]
    return {**lengths, "trunk": float(np.average([lengths[bone] for bone in _TRUNK], weights=shares))}


def as_tables(rows: Sequence[Row]) -> list[Table]:
    """Person by person, then bone by bone, then what was asked for."""
    people = Table(title="People found from their silhouettes")
    for column in ("person", "first frames", "height m"):
        people.add_column(column)
    for column in ("off by cm", "worst bone", "off by %", "heading off by", "joints mm", "IoU", "seconds"):
        people.add_column(column, justify="right")
    for row in rows:
        people.add_row(
            f"{row.variety} {row.number}, {row.sex}", row.stance, f"{row.height_m:.2f}",
            f"{row.height_cm:+.1f}", row.worst_bone.replace("_", " "),
            f"{row.bones_percent[row.worst_bone]:+.1f}", f"{row.heading_deg:+.0f}°",
            f"{row.joints_mm:.0f}", f"{row.iou:.3f}", f"{row.seconds:.0f}",
        )  # fmt: skip
    return [
        people,
        *(table for variety in Variety for table in _sums([r for r in rows if r.variety is variety])),
    ]


def _sums(rows: Sequence[Row]) -> list[Table]:
    if not rows:
        return []
    bones = Table(
        title=f"Errors in %, {rows[0].variety}", caption="pelvis and torso do not count: the trunk does"
    )
    for column in ("bone", "median", "95th percentile", "largest", "mean with sign"):
        bones.add_column(column, justify="left" if column == "bone" else "right")
    for bone in (*BONES, *_TRUNK):
        errors = np.array([row.bones_percent[bone] for row in rows])
        figures = (*np.percentile(np.abs(errors), [50, 95, 100]), errors.mean())
        bones.add_row(bone.replace("_", " "), *(f"{figure:.1f}" for figure in figures))
    asked = Table(title=f"As asked for, {rows[0].variety}")
    asked.add_column("what")
    asked.add_column("people", justify="right")
    for what, held in (
        (f"height within {HEIGHT_CM:g} cm", [abs(row.height_cm) <= HEIGHT_CM for row in rows]),
        (f"height, and all bones within {BONE_PERCENT:g} %", [row.is_found for row in rows]),
        (f"heading within {HEADING_DEG:g} degrees", [row.faces_right for row in rows]),
    ):
        asked.add_row(what, f"{sum(held)} of {len(held)}")
    return [bones, asked]
