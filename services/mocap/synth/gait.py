"""Footsteps along a path: where both feet are at any time, without sliding on the floor.

A foot is somewhere along the pelvis's path: it stays at one point of it while it stands and goes on to the
next while it swings. On top of that it rolls over its sole, from the heel to the tip of the toes.
"""

from dataclasses import dataclass
from math import ceil, pi, radians

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Body
from services.mocap.body.skeleton import SEGMENT_INDEX, SIDES, Side
from services.mocap.synth.legs import FootTargets
from services.mocap.types import Floats

_HEEL_RISE = radians(32)
_TOE_RISE = radians(17)
_LIFT_M = 0.04
# A foot that goes less far, or has less time, rolls and lifts less.
_FULL_STRIDE_M, _UNHURRIED_S = 0.55, 0.4
_TOE_OUT = radians(7)
ON_BALL = radians(30)


@dataclass(frozen=True, eq=False)
class Path:
    """The pelvis's way over the floor, on a circle about the origin, densely sampled in time."""

    radius_m: float
    time_s: Floats
    """(T,) increasing."""
    turns: Floats
    """(T, 2) radians gone along the circle, counterclockwise from (0, -radius), and turned on the spot."""

    def turns_at(self, time_s: float) -> Floats:
        """(2,) turns at one time; before its beginning and after its end the path stands still."""
        return np.array([np.interp(time_s, self.time_s, column) for column in self.turns.T])

    def place(self, turns: Floats) -> tuple[Floats, Floats]:
        """Floor position (N, 2) in metres and heading (N,) in radians at (N, 2) turns."""
        along = turns[:, 0]
        position_m = self.radius_m * np.stack([np.sin(along), -np.cos(along)], axis=1)
        return position_m, turns.sum(axis=1)


@dataclass(frozen=True)
class Footstep:
    """One foot's way from one stand to the next."""

    side: Side
    start_s: float
    period_s: float
    """Time from this step's start to the next one's, which the other foot makes."""
    half_width_m: float
    """Distance of the foot from the path where it comes to stand."""

    @property
    def lift_s(self) -> float:
        """When the foot leaves the floor; before and after, both feet are on it."""
        return self.start_s + 0.1 * self.period_s

    @property
    def land_s(self) -> float:
        """When the foot is on the floor again."""
        return self.start_s + 0.9 * self.period_s

    @property
    def stand_s(self) -> float:
        """When the pelvis passes the place where the foot comes to stand: early in its stance."""
        return self.start_s + 1.38 * self.period_s


def make_steps(start_s: float, end_s: float, period_s: float, half_width_m: float) -> list[Footstep]:
    """Steps of left and right in turn from start to end, at least two, none longer than a period."""
    n = max(2, ceil((end_s - start_s) / period_s))
    period_s = (end_s - start_s) / n
    return [Footstep(SIDES[i % 2], start_s + i * period_s, period_s, half_width_m) for i in range(n)]


class SoleRoll:
    """How a foot rolls over its sole without slipping, pitched toe down (positive) or toe up."""

    def __init__(self, body: Body) -> None:
        """Roll the left foot's mesh from level to both sides in small turns, each about its lowest vertex."""
        vertices_m = body.vertices_m[SEGMENT_INDEX["left_foot"]][:, [0, 2]]
        self._pitch = np.linspace(-0.6, 0.9, 1501)
        cosine, sine = np.cos(self._pitch), np.sin(self._pitch)
        heights_m = np.outer(cosine, vertices_m[:, 1]) - np.outer(sine, vertices_m[:, 0])
        self._ankle_z_m = -heights_m.min(axis=1)
        self.ball_m = float(vertices_m[heights_m[np.abs(self._pitch - ON_BALL).argmin()].argmin(), 0])
        """How far ahead of the ankle's place on a level foot the ball is on which the raised foot stands."""
        # While the foot turns about its contact, the ankle goes ahead by its height over it per radian.
        forward_m = np.concatenate([[0.0], np.cumsum(np.diff(self._pitch) * self._ankle_z_m[1:])])
        level = int(np.abs(self._pitch).argmin())
        self._ankle_x_m = forward_m - forward_m[level]

    def targets(self, xy_m: Floats, yaw: Floats, pitch: Floats, lift_m: Floats) -> FootTargets:
        """A foot that would have its ankle over (N, 2) if it were level, pitched (N,) and lifted (N,)."""
        ahead_m, height_m = (np.interp(pitch, self._pitch, m) for m in (self._ankle_x_m, self._ankle_z_m))
        xy_m = xy_m + ahead_m[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)])
        R_world_foot = Rotation.from_euler("ZY", np.column_stack([yaw, pitch])).as_matrix()
        return FootTargets(np.column_stack([xy_m, height_m + lift_m]), R_world_foot)


def foot_targets(
    time_s: Floats, path: Path, steps: list[Footstep], roll: SoleRoll, side: Side, stand_m: float
) -> FootTargets:
    """One foot at (N,) times; before its first step it stands stand_m to its side of the path's beginning."""
    stand, beside_from_m = path.turns[0], stand_m
    turns, beside_m = np.tile(stand, (len(time_s), 1)), np.full(len(time_s), stand_m)
    pitch, lift_m = np.zeros(len(time_s)), np.zeros(len(time_s))
    for step in (step for step in steps if step.side == side):
        swung = np.clip((time_s - step.lift_s) / (step.land_s - step.lift_s), 0.0, 1.0)
        # Away quickly, since the pelvis goes on meanwhile, and softly down.
        done = swung**1.6 * (3.0 - 2.0 * swung**0.8)
        next_stand = path.turns_at(step.stand_s)
        turns += (next_stand - stand) * done[:, None]
        beside_m += (step.half_width_m - beside_from_m) * done
        stride_m = path.radius_m * float(next_stand[0] - stand[0])
        size = 0.4 + 0.6 * min(1.0, stride_m / _FULL_STRIDE_M)
        size *= min(1.0, step.period_s / _UNHURRIED_S) ** 2
        pitch += size * _step_pitch(time_s, step)
        lift_m += size * _LIFT_M * np.sin(pi * swung) ** 2
        stand, beside_from_m = next_stand, step.half_width_m
    sign = 1.0 if side == "left" else -1.0
    position_m, heading = path.place(turns)
    position_m += sign * beside_m[:, None] * np.column_stack([-np.sin(heading), np.cos(heading)])
    return roll.targets(position_m, heading + sign * _TOE_OUT, pitch, lift_m)


def _step_pitch(time_s: Floats, step: Footstep) -> Floats:
    """The foot's pitch (N,) around a step: the heel rises before the foot lifts, the toes before it lands."""
    swing_s = step.land_s - step.lift_s
    heel = bump(time_s, step.lift_s - 0.52 * step.period_s, step.lift_s, step.lift_s + 0.55 * swing_s)
    toes = bump(time_s, step.land_s - 0.45 * swing_s, step.land_s, step.land_s + 0.2 * step.period_s)
    return _HEEL_RISE * heel - _TOE_RISE * toes


def bump(time_s: Floats, start_s: float, peak_s: float, end_s: float) -> Floats:
    """0 up to the start, 1 at the peak, 0 from the end on, without corners."""
    return min_jerk((time_s - start_s) / (peak_s - start_s)) - min_jerk((time_s - peak_s) / (end_s - peak_s))


def min_jerk(done: Floats) -> Floats:
    """The way from 0 to 1 with the least jerk, 0 before and 1 after it; its top speed is 1.875."""
    s = np.clip(done, 0.0, 1.0)
    return s**3 * (10.0 + s * (6.0 * s - 15.0))
