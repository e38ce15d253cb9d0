"""The measures of a body in centimetres, taken from its mesh as with a tape.

The body stands upright with its arms held out level (the rest pose), as for measuring the arm span. The left
side is measured.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from services.mocap.body.actor import Actor, Body
from services.mocap.body.kinematics import N_DOF, joint_positions, segment_transforms
from services.mocap.body.shape_space import body_of, clip_to_bounds, vector_of
from services.mocap.body.skeleton import JOINT_INDEX, SEGMENT_INDEX, TRUNK
from services.mocap.body.surface import moved
from services.mocap.types import Floats

_LEVELS = 25
"""Number of cross-sections for finding the largest or smallest."""
_DIRECTIONS = 12
"""The widest of all directions of shapes; the others together move no measure by a millimetre."""
_CM_PER_M = 100.0
_HIPS = (*TRUNK, "left_thigh", "right_thigh")


@dataclass(frozen=True)
class Measure:
    """One measure of a body."""

    name: str
    cm: float
    how: str
    """Where to put the tape."""
    uncertainty_cm: float | None = None
    """One standard deviation, if known."""


def measure(body: Body) -> tuple[Measure, ...]:
    """All measures: height, span, widths, lengths from joint to joint, and girths over the skin."""
    figure = _Figure(body)
    rows = (*_extents(figure), *_lengths(figure), *_girths(figure))
    return tuple(Measure(name, _CM_PER_M * metres, how) for name, metres, how in rows)


def with_uncertainties(
    measures: tuple[Measure, ...], actor: Actor, covariance: Floats
) -> tuple[Measure, ...]:
    """The measures of an actor, each with its standard deviation.

    covariance: (n, n) of the actor's shape vector. The body is measured again, one deviation away in
    each of the directions that are least known.
    """
    x = vector_of(actor)
    variances, directions = np.linalg.eigh(covariance)
    steps = directions[:, -_DIRECTIONS:] * np.sqrt(np.maximum(variances[-_DIRECTIONS:], 0.0))
    here_cm, squares = _cm(actor, x), np.zeros(len(measures))
    for step in steps.T:
        squares += (_cm(actor, clip_to_bounds(x + step)) - here_cm) ** 2
    return tuple(
        replace(row, uncertainty_cm=float(deviation))
        for row, deviation in zip(measures, np.sqrt(squares), strict=True)
    )


def _cm(actor: Actor, x: Floats) -> Floats:
    """(M,) the measures of a shape vector of the actor's mesh."""
    return np.array([row.cm for row in measure(body_of(x, actor.bare))])


_Row = tuple[str, float, str]


def _extents(figure: "_Figure") -> tuple[_Row, ...]:
    floor_m, top_m = figure.extent_m(2)
    low_m, high_m = figure.extent_m(1)
    crotch_m = figure.extent_m(2, "pelvis")[0]
    shoulders_m = figure.breadth_m(figure.joint_m("left_shoulder")[2], TRUNK)
    hips_m = max(
        figure.breadth_m(z, _HIPS) for z in np.linspace(crotch_m, figure.up_the_trunk_m(0.25), _LEVELS)
    )
    return (
        ("height", top_m - floor_m, "from the floor to the top of the head, with shoes and hair"),
        ("arm span", high_m - low_m, "from fingertip to fingertip, arms held out level"),
        ("shoulder width", shoulders_m, "across the back, from shoulder tip to shoulder tip"),
        ("hip width", hips_m, "across the hips where they are widest"),
        ("inside leg", crotch_m - floor_m, "from the floor to the crotch"),
    )


def _lengths(figure: "_Figure") -> tuple[_Row, ...]:
    hand_m = figure.extent_m(1, "left_hand")[1] - figure.joint_m("left_wrist")[1]
    heel_m, toe_m = figure.extent_m(0, "left_foot")
    bone_m = figure.bone_m
    return (
        ("upper arm", bone_m("left_shoulder", "left_elbow"), "from the shoulder's to the elbow's middle"),
        ("forearm", bone_m("left_elbow", "left_wrist"), "from the elbow's to the wrist's middle"),
        ("hand", hand_m, "from the wrist's middle to the tip of the longest finger"),
        ("thigh", bone_m("left_hip", "left_knee"), "from the hip joint to the knee's middle"),
        ("shank", bone_m("left_knee", "left_ankle"), "from the knee's to the ankle's middle"),
        ("foot", toe_m - heel_m, "from the heel to the tip of the toes"),
    )


def _girths(figure: "_Figure") -> tuple[_Row, ...]:
    crotch_m = figure.extent_m(2, "pelvis")[0]
    hip_m, knee_m, ankle_m = (figure.joint_m(f"left_{name}")[2] for name in ("hip", "knee", "ankle"))
    shoulder_m, elbow_m, wrist_m = (
        figure.joint_m(f"left_{name}")[1] for name in ("shoulder", "elbow", "wrist")
    )
    neck_m, head_top_m = figure.joint_m("head")[2], figure.extent_m(2, "head")[1]
    hips_m, waist_m, chest_m = (figure.up_the_trunk_m(share) for share in (0.25, 0.55, 0.80))
    chest = figure.girths_m(2, waist_m, chest_m, TRUNK).max()
    waist = figure.girths_m(2, hips_m, waist_m, TRUNK).min()
    hip = figure.girths_m(2, crotch_m, hips_m, _HIPS).max()
    thigh = figure.girths_m(2, crotch_m, (hip_m + knee_m) / 2, ("left_thigh",)).max()
    calf = figure.girths_m(2, knee_m, ankle_m, ("left_shank",)).max()
    upper_arm = figure.girth_m(1, (shoulder_m + elbow_m) / 2, ("left_upper_arm",))
    forearm = figure.girths_m(1, elbow_m, (elbow_m + wrist_m) / 2, ("left_forearm",)).max()
    head = figure.girths_m(2, neck_m + 0.3 * (head_top_m - neck_m), head_top_m, ("head",)).max()
    return (
        ("chest girth", chest, "level, under the arms, where it is largest"),
        ("waist girth", waist, "level, between hips and ribs, where it is smallest"),
        ("hip girth", hip, "level, feet together, where it is largest"),
        ("thigh girth", thigh, "level, below the crotch, where it is largest"),
        ("calf girth", calf, "level, between knee and ankle, where it is largest"),
        ("upper arm girth", upper_arm, "across the bone, halfway from shoulder to elbow, not tensed"),
        ("forearm girth", forearm, "across the bone, below the elbow, where it is largest"),
        ("head girth", head, "level, over brows and back of the head, where it is largest"),
    )


class _Figure:
    """A body in the rest pose, to be measured and cut across."""

    def __init__(self, body: Body) -> None:
        rest = np.zeros((1, N_DOF))
        T_world_segment = segment_transforms(rest, body.offsets_m)[0]
        self._joints_m = joint_positions(rest, body.offsets_m)[0]
        self._vertices_m = list(map(moved, body.vertices_m, T_world_segment))
        edges = [faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2) for faces in body.faces]
        self._edges = [e[e[:, 0] < e[:, 1]] for e in edges]  # one of the two directions of each edge

    def joint_m(self, name: str) -> Floats:
        """A joint's centre (3,)."""
        return np.asarray(self._joints_m[JOINT_INDEX[name]], np.float64)

    def bone_m(self, one: str, other: str) -> float:
        """From a joint to another."""
        return float(np.linalg.norm(self.joint_m(one) - self.joint_m(other)))

    def up_the_trunk_m(self, share: float) -> float:
        """The height at this fraction of the way from the hip joints to the shoulder joints."""
        hip_m, shoulder_m = self.joint_m("left_hip")[2], self.joint_m("left_shoulder")[2]
        return float(hip_m + share * (shoulder_m - hip_m))

    def extent_m(self, axis: int, *segments: str) -> tuple[float, float]:
        """The lowest and highest coordinate of some segments, or of the whole body where none is named."""
        chosen = [self._vertices_m[SEGMENT_INDEX[name]] for name in segments] or self._vertices_m
        along = np.concatenate([vertices_m[:, axis] for vertices_m in chosen])
        return float(along.min()), float(along.max())

    def section_m(self, axis: int, at_m: float, segments: tuple[str, ...]) -> Floats:
        """Points (N, 2) on the skin of some segments where a plane across an axis cuts them."""
        points = []
        for segment in (SEGMENT_INDEX[name] for name in segments):
            vertices_m, edges = self._vertices_m[segment], self._edges[segment]
            above, below = (vertices_m[:, axis] - at_m)[edges].T
            crosses = (above < 0) != (below < 0)
            one, other = vertices_m[edges[crosses]].transpose(1, 0, 2)
            share = (above[crosses] / (above[crosses] - below[crosses]))[:, None]
            points.append(one + share * (other - one))
        return np.delete(np.concatenate(points), axis, axis=1)

    def breadth_m(self, height_m: float, segments: tuple[str, ...]) -> float:
        """Width of some segments at a height; 0 if there is nothing."""
        across = self.section_m(2, height_m, segments)[:, 1]
        return float(np.ptp(across)) if across.size else 0.0

    def girth_m(self, axis: int, at_m: float, segments: tuple[str, ...]) -> float:
        """Length of a tight tape around some segments, which spans hollows; 0 if there is nothing."""
        try:
            return float(ConvexHull(self.section_m(axis, at_m, segments)).area)  # in the plane: the perimeter
        except (QhullError, ValueError):  # nothing there, or a single point
            return 0.0

    def girths_m(self, axis: int, start_m: float, end_m: float, segments: tuple[str, ...]) -> Floats:
        """Girths (25,) at even steps from one place to another."""
        places_m = np.linspace(start_m, end_m, _LEVELS)
        return np.array([self.girth_m(axis, at_m, segments) for at_m in places_m])
