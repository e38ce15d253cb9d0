"""The space of shapes that a fit searches: a vector of logarithms, zero for the generic body.

Its parameters are those that silhouettes can determine: the height, the bones, the depth of the hip joints,
the trunk's width and depth, the girth of the limbs, and the size of neck, head, hands and feet. Neighbouring
segments share the control at their joint. One direction changes almost nothing: greater height with shorter
bones and slimmer profiles. There, and where silhouettes determine little, the deviations decide, or
fit/priors.py, which includes correlations.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from services.mocap.body.actor import DEFAULT_HEIGHT_M, Actor, Body, build_body
from services.mocap.body.bones import BONES
from services.mocap.body.profiles import Profile, bezier_weights
from services.mocap.body.skeleton_table import ROWS
from services.mocap.types import Floats

Kind = Literal["height", "bone", "joint", "profile"]
GENERIC_ACTOR = Actor()


@dataclass(frozen=True)
class ShapeParameter:
    """One number of a shape: the factor by which something differs from the generic body."""

    name: str
    kind: Kind
    deviation: float
    """Standard deviation of the factor's logarithm among people; clothes and what differs between body
    models are included."""
    lowest: float
    """The smallest factor."""
    highest: float


# Deviations and ranges as for lengths (skeleton_table.py). That of the hips' depth, 2 cm, is mostly that of
# what models and rigs call a hip.
_PROFILES = {
    "trunk_width_hip": (0.10, 0.6, 1.7),
    "trunk_width_belly": (0.15, 0.6, 1.8),
    "trunk_width_waist": (0.16, 0.6, 1.9),
    "trunk_width_ribs": (0.15, 0.6, 1.8),
    "trunk_width_chest": (0.12, 0.6, 1.7),
    "trunk_width_top": (0.12, 0.6, 1.7),
    "trunk_depth_hip": (0.15, 0.6, 1.8),
    "trunk_depth_belly": (0.20, 0.6, 2.0),
    "trunk_depth_waist": (0.22, 0.6, 2.2),
    "trunk_depth_ribs": (0.20, 0.6, 2.0),
    "trunk_depth_chest": (0.15, 0.6, 1.8),
    "trunk_depth_top": (0.15, 0.6, 1.8),
    "neck_girth": (0.12, 0.6, 1.7),
    "head_width": (0.08, 0.7, 1.5),
    "head_depth": (0.08, 0.7, 1.5),
    "arm_girth_shoulder": (0.15, 0.6, 1.8),
    "arm_girth_biceps": (0.18, 0.6, 1.8),
    "arm_girth_elbow": (0.12, 0.6, 1.8),
    "arm_girth_forearm": (0.15, 0.6, 1.8),
    "arm_girth_wrist": (0.12, 0.6, 1.8),
    "hand_girth": (0.12, 0.6, 1.7),
    "leg_girth_hip": (0.13, 0.6, 1.7),
    "leg_girth_thigh": (0.15, 0.6, 1.8),
    "leg_girth_knee": (0.12, 0.6, 1.8),
    "leg_girth_calf": (0.14, 0.6, 1.8),
    "leg_girth_ankle": (0.15, 0.6, 2.0),
    "foot_width": (0.10, 0.6, 1.7),
    "foot_depth": (0.14, 0.7, 2.0),
}


_CONTROLS = {row.name: (row.width, row.depth) for row in ROWS}
"""Segment -> the parameters that are the controls of its width, and those of its depth."""

PARAMETERS: tuple[ShapeParameter, ...] = (
    ShapeParameter("height", "height", 0.08, 0.41, 1.39),  # 0.7 to 2.4 m
    *(
        ShapeParameter(length.bone, "bone", length.deviation, length.lowest, length.highest)
        for row in ROWS
        for length in row.lengths
    ),
    ShapeParameter("hip_depth", "joint", 0.2, 0.6, 1.7),
    *(ShapeParameter(name, "profile", *numbers) for name, numbers in _PROFILES.items()),
)
"""The parameters, in the order of every shape vector."""
INDEX: dict[str, int] = {parameter.name: i for i, parameter in enumerate(PARAMETERS)}
"""Parameter -> its place in a shape vector."""
DEVIATIONS: Floats = np.array([parameter.deviation for parameter in PARAMETERS])
LOWER: Floats = np.log([parameter.lowest for parameter in PARAMETERS])
UPPER: Floats = np.log([parameter.highest for parameter in PARAMETERS])


# How the parameters change, in logarithms, if the same body gets a larger `height`. Lengths in metres stay,
# and so do factors across a segment that a bone scales; the trunk's widths follow bones in part.
_STAYS = ("hip_depth", "trunk_width_top", "head_", "hand_", "foot_width")
_TRUNK_FOLLOWS = {"hip": -0.46, "belly": -0.43, "waist": -0.38, "ribs": -0.19, "chest": -0.03}


def _restated(parameter: ShapeParameter) -> float:
    if parameter.kind == "height":
        return 1.0
    if parameter.name.startswith(_STAYS):
        return 0.0
    extent, _, place = parameter.name.rpartition("_")
    return _TRUNK_FOLLOWS[place] if extent == "trunk_width" else -1.0


_RESTATED: Floats = np.array([_restated(parameter) for parameter in PARAMETERS])


def of_kind(*kinds: Kind) -> tuple[int, ...]:
    """Indices of the parameters of some kinds, as for a fit from coarse to fine."""
    return tuple(i for i, parameter in enumerate(PARAMETERS) if parameter.kind in kinds)


def clip_to_bounds(x: Floats) -> Floats:
    """Shape vectors (…, len(PARAMETERS)) moved to the nearest within the bounds."""
    return np.clip(x, LOWER, UPPER)


def actor_of(x: Floats, base: Actor = GENERIC_ACTOR) -> Actor:
    """The actor of a shape vector (len(PARAMETERS),) within the bounds, with the mesh and what base wears."""
    factors = dict(zip(INDEX, np.exp(x).tolist(), strict=True))
    lengths_heights = base.form.lengths_heights
    height_m = DEFAULT_HEIGHT_M * factors["height"]
    return Actor(
        height=height_m,
        bone_lengths={name: lengths_heights[name] * height_m * factors[name] for name in BONES},
        profiles={
            segment: Profile(
                width=tuple(factors[name] for name in width), depth=tuple(factors[name] for name in depth)
            )
            for segment, (width, depth) in _CONTROLS.items()
        },
        hip_depth=factors["hip_depth"],
        mesh=base.mesh,
        skirt=base.skirt,
        hat=base.hat,
        colours=base.colours,
    )


def vector_of(actor: Actor) -> Floats:
    """The shape vector (len(PARAMETERS),) of an actor, or the nearest one in the space.

    Zero is the actor's own mesh, if there is one. Profiles with other numbers of controls are
    approximated; controls that the space shares are averaged.
    """
    lengths_heights = actor.form.lengths_heights
    votes: dict[str, list[float]] = {name: [] for name in INDEX}
    votes["height"].append(actor.height / DEFAULT_HEIGHT_M)
    votes["hip_depth"].append(actor.hip_depth)
    for name, length_m in actor.bone_lengths.items():
        votes[name].append(length_m / (lengths_heights[name] * actor.height))
    for segment, profile in actor.profiles.items():
        for names, factors in zip(_CONTROLS[segment], (profile.width, profile.depth), strict=True):
            for name, factor in zip(names, _resampled(np.array(factors), len(names)), strict=True):
                votes[name].append(float(factor))
    return clip_to_bounds(np.array([np.mean(np.log(v)) if v else 0.0 for v in votes.values()]))


def _resampled(controls: Floats, n_controls: int) -> Floats:
    """n_controls control values whose curve is nearest to that of other controls."""
    if len(controls) == n_controls:
        return controls
    positions = np.linspace(0.0, 1.0, 33)
    curve = bezier_weights(positions, len(controls)) @ controls
    nearest, *_ = np.linalg.lstsq(bezier_weights(positions, n_controls), curve, rcond=None)
    return np.clip(np.asarray(nearest, np.float64), controls.min(), controls.max())


_HEIGHT_ROUNDS, _SAME_HEIGHT = 4, 2e-4
"""The height is restated at most so many times, until its logarithm is right to the second number: how deep a
foot without a shoe is depends on the height itself."""


def with_true_height(x: Floats, base: Actor = GENERIC_ACTOR) -> Floats:
    """The shape vector of the same body, to three millimetres, whose height parameter is its standing
    height without shoes.

    A fit may find a tall actor with short bones and slim profiles; written results should have the height
    that a measuring rod shows. Within the bounds.
    """
    for _ in range(_HEIGHT_ROUNDS):
        body = body_of(without_shoes(x), base.bare)
        off = np.log(body.standing_height_m / body.height_m)
        if abs(off) < _SAME_HEIGHT:
            break
        x = clip_to_bounds(x + off * _RESTATED)
    return x


def without_shoes(x: Floats) -> Floats:
    """The shape vector with feet no deeper than the generic ones."""
    barefoot = x.copy()
    barefoot[INDEX["foot_depth"]] = min(x[INDEX["foot_depth"]], 0.0)
    return barefoot


def body_of(x: Floats, base: Actor = GENERIC_ACTOR) -> Body:
    """The body of a shape vector (len(PARAMETERS),), with the mesh and what base wears."""
    return build_body(actor_of(x, base))
