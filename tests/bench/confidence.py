"""Fits the weights of services.mocap.search.lost_probability, and tests them on other takes than those.

Every take is fitted, unless it has an actor.toml, and tracked in this process, as `xormocap track` does. What
the tracker knew of each part in each frame is set beside the truth. Takes weigh alike, however long they are.
"""

import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from bench.limb_scores import LIMBS, RIGHT_MM
from bench.people import true_joints_m
from bench.studio_takes import with_true_silhouettes
from services.library import SearchSettings, fit, refine, track, write_result
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.search.lost_probability import EVIDENCE, LOST_M, WEIGHTS
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import Take, open_take
from services.mocap.take.marks import PARTS, Part
from services.mocap.take.tables import REFERENCE_JOINTS, from_take_world
from services.mocap.types import Floats, Mask
from services.runs.take_fit import TakeFit

_JUDGED_BY: dict[Part, tuple[str, ...]] = {
    "torso": ("left_hip", "right_hip", "left_shoulder", "right_shoulder", "neck"),
    "head": ("head_top",),
    **LIMBS,
}
_STEADINESS = 10.0
"""What a weight of one costs, as so many frames: it draws weights to zero that little speaks for."""
_ROUNDS = 30
_BINS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)


@dataclass(frozen=True, eq=False)
class Known:
    """Of one take, its N parts in frames."""

    take: str
    evidence: Floats
    """(N, len(EVIDENCE))"""
    off_mm: Floats
    """(N,) how far the worst joint of the part is off."""

    @property
    def is_lost(self) -> Mask:
        """(N,)"""
        return np.asarray(self.off_mm > 1000.0 * LOST_M)


def known_of(folder: Path, *, true_silhouettes: bool) -> Known:
    """Track a take. Raises TakeError and UserError as these do."""
    with tempfile.TemporaryDirectory(prefix="xormocap-bench-") as temporary:
        made = Path(temporary) / folder.resolve().name
        take = open_take(with_true_silhouettes(folder, made) if true_silhouettes else folder)
        true_m = from_take_world(true_joints_m(take), take.settings.up)
        actor = take_actor(take) or _fitted_twice(take, Path(temporary) / "result")
        body = build_body(actor if isinstance(actor, Actor) else actor.actor)
        evidence, off_mm = list[Floats](), list[float]()
        for frame in track(take, actor):
            if not len(frame.solution.evidence):
                continue
            found_m = joint_positions(frame.solution.pose[None], body.offsets_m)[0]
            off_m = {
                name: np.linalg.norm(found_m[JOINT_INDEX[name]] - true_m[frame.number, j])
                for j, name in enumerate(REFERENCE_JOINTS)
                if name in JOINT_INDEX
            }
            evidence.append(frame.solution.evidence)
            off_mm += [1000.0 * max(float(off_m[joint]) for joint in _JUDGED_BY[part]) for part in PARTS]
        return Known(made.name, np.concatenate(evidence), np.array(off_mm))


def _fitted_twice(take: Take, result: Path) -> TakeFit:
    first = fit(take)
    one_way = track(take, first, search=SearchSettings(both_ways=False))
    write_result(result, take, first.actor, one_way, formats=())
    return refine(take, result)


def weights_of(takes: list[Known]) -> Floats:
    """(1 + len(EVIDENCE),) the bias and the weights, by iteratively reweighted least squares."""
    evidence, is_lost = (
        np.concatenate([t.evidence for t in takes]),
        np.concatenate([t.is_lost for t in takes]),
    )
    each = np.concatenate([np.full(len(t.evidence), 1.0 / len(t.evidence)) for t in takes])
    each *= len(each) / len(takes)
    mean, deviation = evidence.mean(axis=0), np.maximum(evidence.std(axis=0), 1e-9)
    rows = np.column_stack([np.ones(len(evidence)), (evidence - mean) / deviation])
    drawn = _STEADINESS * np.diag([0.0, *np.ones(len(EVIDENCE))])
    found = np.zeros(rows.shape[1])
    for _ in range(_ROUNDS):
        probability = 1.0 / (1.0 + np.exp(-rows @ found))
        curvature = each * (probability * (1.0 - probability) + 1e-6)
        slope = rows.T @ (each * (is_lost - probability)) - drawn @ found
        found = found + np.linalg.solve((rows.T * curvature) @ rows + drawn, slope)
    weights: Floats = found[1:] / deviation
    return np.array([found[0] - weights @ mean, *weights])


def _probabilities(known: Known, weights: Floats) -> Floats:
    """(N,)"""
    probabilities: Floats = 1.0 / (1.0 + np.exp(-(known.evidence @ weights[1:] + weights[0])))
    return probabilities


@dataclass(frozen=True)
class Row:
    """A weight, as fitted to all takes."""

    evidence: str
    weight: float


def as_rows(takes: list[Known]) -> list[Row]:
    """The weights, the bias first; none of no takes."""
    if not takes:
        return []
    return [
        Row(name, float(weight)) for name, weight in zip(("bias", *EVIDENCE), weights_of(takes), strict=True)
    ]


def as_tables(takes: list[Known]) -> list[Table]:
    """The weights as fitted to all takes, and how right they are on each take when fitted to the others.

    No tables of no takes.
    """
    if not takes:
        return []
    weights = Table("evidence", "fitted", "in use", box=SIMPLE_HEAD, title="Weights")
    for row, used in zip(as_rows(takes), WEIGHTS, strict=False):
        weights.add_row(row.evidence, f"{row.weight:.3f}", f"{used:.3f}")
    return [weights, *(_reliability(takes, name) for name in ("fitted to the other takes", "in use"))]


def _reliability(takes: list[Known], name: str) -> Table:
    others = [[other for other in takes if other is not take] for take in takes]
    told = [
        _probabilities(take, WEIGHTS if name == "in use" or not rest else weights_of(rest))
        for take, rest in zip(takes, others, strict=True)
    ]
    probability, off_mm = np.concatenate(told), np.concatenate([take.off_mm for take in takes])
    table = Table("probability", "parts", "lost %", "right %", box=SIMPLE_HEAD, title=f"Weights {name}")
    for low, high in pairwise(_BINS):
        chosen = off_mm[(probability >= low) & (probability <= high if high == 1.0 else probability < high)]
        shares = [100.0 * float(np.mean(x)) for x in (chosen > 1000.0 * LOST_M, chosen < RIGHT_MM)]
        cells = [f"{share:.1f}" for share in shares] if len(chosen) else ["", ""]
        table.add_row(f"{low:.2f} to {high:.2f}", str(len(chosen)), *cells)
    return table
