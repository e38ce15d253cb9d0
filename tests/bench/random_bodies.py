"""Random people before the synthetic studio: their bodies, how they stand, and what bad silhouettes show.

Nothing here is drawn from what a fit takes for granted (services.mocap.fit.priors): proportions of the
population follow published means and deviations of both sexes, and the varied ones know no rule at all.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np

from bench.degradations import bitten, with_specks
from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.shape_space import INDEX, PARAMETERS, body_of, clip_to_bounds
from services.mocap.body.skeleton import DOF_INDEX, SIDES
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.synth.walk import STAND_S, walk
from services.mocap.types import Bytes, Floats, Mask
from services.segmentation.cleanup import cleanup

Sex = Literal["female", "male"]
FPS = 15.0


class Variety(StrEnum):
    """How much people differ from each other."""

    POPULATION = "population"
    """As adults do: proportions by sex, with their deviations at a given stature."""
    VARIED = "varied"
    """Every bone is up to 12 % longer or shorter than the generic one, whatever the others are."""


class Stance(StrEnum):
    """What somebody does in the first frames."""

    A_POSE = "A pose"
    T_POSE = "T pose"
    RELAXED = "relaxed"
    WALKING = "walking"


_STATURES_M: dict[Sex, tuple[float, float]] = {"female": (1.50, 1.85), "male": (1.58, 2.00)}
# Bone -> by how much (logarithm) men's share of the stature exceeds the mean of both sexes', and the
# deviation at a given stature and sex: rounded from means, deviations and correlations with stature in the
# 2012 US Army survey (Gordon et al. 2014, NATICK/TR-15/007) of the measure next to the bone: biacromial and
# hip breadth, acromion to radiale, radiale to stylion, trochanterion, tibiale, sitting height, hand, foot.
_BONES = {
    "hip_width": (-0.030, 0.060),
    "pelvis": (0.0, 0.035),
    "torso": (-0.005, 0.035),
    "shoulder_width": (0.027, 0.043),
    "neck": (0.0, 0.080),
    "head": (-0.015, 0.045),
    "upper_arm": (0.0, 0.028),
    "forearm": (0.015, 0.036),
    "hand": (-0.005, 0.035),
    "thigh": (-0.004, 0.040),
    "shank": (0.002, 0.026),
    "foot": (0.011, 0.032),
}
_VARIED = 0.12
_MOST_DEVIATIONS = 2.5
_STOUT = (-1.5, 2.0)
"""From slim to heavy, in steps that widen the waist's depth by _STOUT_GIRTH each."""
_STOUT_GIRTHS = {"trunk_width": 0.09, "trunk_depth": 0.13, "neck": 0.05, "arm": 0.08, "leg": 0.07}
_OWN_GIRTH = 0.05
_SWAY_RAD = 0.03


@dataclass(frozen=True, eq=False)
class Person:
    """Somebody's body, poses, and what is seen of them."""

    sex: Sex
    stance: Stance
    x: Floats
    """The shape vector."""
    body: Body
    poses: Floats
    """(F, D)"""
    seen: TriPlanes
    """(F, P, H, W) with bites and specks, cleaned up as segmentation does."""


def somebody(rig: Rig, variety: Variety, stance: Stance, n_frames: int, seed: int) -> Person:
    """A random person in the first frames of a take."""
    rng = np.random.default_rng((seed, 4))
    sex: Sex = "female" if rng.random() < 0.5 else "male"
    x = _shape(sex, variety, rng)
    body = body_of(x)
    poses = _turned(_poses(body, stance, n_frames, rng), rng.uniform(-np.pi, np.pi))
    return Person(sex, stance, x, body, poses, seen_of(body, poses, rig, rng))


def seen_of(body: Body, poses: Floats, rig: Rig, rng: np.random.Generator) -> TriPlanes:
    """Silhouettes (F, P, H, W) of a body in poses (F, D) with bites and specks, cleaned up."""
    backend = CpuBackend(body, rig)
    drawn = backend.coverage(poses, ALL_SURFACES, Region.whole(rig))
    backend.close()
    return TriPlanes.sure(np.array([_spoilt(planes, rig, rng) for planes in drawn]))


def _shape(sex: Sex, variety: Variety, rng: np.random.Generator) -> Floats:
    """A shape vector (len(PARAMETERS),) that stands as tall as its sex does, within the bounds."""
    x, stout = np.zeros(len(PARAMETERS)), rng.uniform(*_STOUT)
    for name, (men, deviation) in _BONES.items():
        by_sex = men if sex == "male" else -men
        off = deviation * float(np.clip(rng.standard_normal(), -_MOST_DEVIATIONS, _MOST_DEVIATIONS))
        x[INDEX[name]] = by_sex + off if variety is Variety.POPULATION else rng.uniform(-_VARIED, _VARIED)
    for i, parameter in enumerate(PARAMETERS):
        if parameter.kind == "profile":
            girths = (share for name, share in _STOUT_GIRTHS.items() if parameter.name.startswith(name))
            x[i] = stout * next(girths, 0.0) + _OWN_GIRTH * float(rng.standard_normal())
    x = clip_to_bounds(x)
    x[INDEX["height"]] += np.log(rng.uniform(*_STATURES_M[sex]) / body_of(x).standing_height_m)
    return x


def _poses(body: Body, stance: Stance, n_frames: int, rng: np.random.Generator) -> Floats:
    """(n_frames, D) on the floor, facing along x in the first frame or nearly so."""
    if stance in (Stance.A_POSE, Stance.WALKING):
        start = 0 if stance is Stance.A_POSE else round(2 * STAND_S * FPS)
        poses = walk(start + max(n_frames, 60), FPS, body)[start : start + n_frames]
    else:
        poses = np.zeros((n_frames, N_DOF))
        for side in SIDES:
            arm_deg, elbow_deg = (-3.0, 6.0) if stance is Stance.T_POSE else (-74.0, 18.0)
            poses[:, DOF_INDEX[f"{side}_shoulder_elevation"]] = np.radians(arm_deg)
            poses[:, DOF_INDEX[f"{side}_elbow_flexion"]] = np.radians(elbow_deg)
            poses[:, DOF_INDEX[f"{side}_hip_abduction"]] = np.radians(5.0)
            poses[:, DOF_INDEX[f"{side}_ankle_inversion"]] = np.radians(-5.0)
    poses = poses.copy()
    # Nobody stands quite alike, nor quite still.
    swing = np.sin(np.arange(n_frames)[:, None] / FPS + rng.uniform(0, 2 * np.pi, N_DOF))
    poses[:, 6:] += rng.normal(0.0, 2 * _SWAY_RAD, N_DOF - 6) + _SWAY_RAD * swing[:, 6:]
    poses = clip_to_limits(poses)
    for pose in poses:
        pose[DOF_INDEX["root_z"]] -= body.lowest_point_m(pose)
    return poses


def _turned(poses: Floats, angle_rad: float) -> Floats:
    """The poses (F, D), turned about the world's upright axis."""
    turned, (c, s) = poses.copy(), (np.cos(angle_rad), np.sin(angle_rad))
    turned[:, :2] = poses[:, :2] @ np.array([[c, s], [-s, c]])
    turned[:, DOF_INDEX["root_heading"]] += angle_rad
    return turned


def _spoilt(planes: Bytes, rig: Rig, rng: np.random.Generator) -> Bytes:
    """Silhouettes (P, H, W) as a bad segmentation makes them."""
    masks: Mask = unpack(planes, rig.n_cameras)
    return pack(np.array([cleanup(with_specks(bitten(m, rng), rng)) for m in masks]))
