"""Free footwork: a foot stands, steps to another place, rises onto its ball, turns on it, leaves the floor.

Beside gait, which walks along a path, this places every step by hand, wherever a movement wants it.
"""

from dataclasses import dataclass, field
from math import cos, hypot, pi, radians, sin

import numpy as np
from scipy.ndimage import gaussian_filter1d

from services.mocap.body.skeleton import Side
from services.mocap.synth.gait import ON_BALL, SoleRoll, bump, min_jerk
from services.mocap.synth.legs import FootTargets
from services.mocap.types import Floats

_FULL_STRIDE_M = 0.5
_HEEL_RISE = radians(28)
_TOE_RISE = radians(10)


@dataclass(frozen=True)
class Place:
    """Where a level foot stands: its ankle over the floor, and where it points."""

    x_m: float
    y_m: float
    yaw: float

    def ahead(self, ahead_m: float, left_m: float, turn: float = 0.0) -> "Place":
        """The place reached by going ahead and to the left as this one points, and turning then."""
        c, s = cos(self.yaw), sin(self.yaw)
        return Place(
            self.x_m + c * ahead_m - s * left_m, self.y_m + s * ahead_m + c * left_m, self.yaw + turn
        )


@dataclass(frozen=True)
class Move:
    """One way of a foot from a place to another: through the air, or turning on its ball."""

    start_s: float
    end_s: float
    place: Place
    lift_m: float
    """How high the foot goes between; 0 for a turn on the ball of the foot."""


@dataclass
class Foot:
    """One foot's plan."""

    side: Side
    first: Place
    """Where it begins."""
    moves: list[Move] = field(default_factory=list)

    def step(self, start_s: float, end_s: float, place: Place, lift_m: float) -> None:
        """Plan the next move; raises ValueError when it begins before the last one is done."""
        if self.moves and start_s < self.moves[-1].end_s - 1e-9:
            raise ValueError(f"{self.side} foot: a move at {start_s:.3f} s before the last one is done")
        self.moves.append(Move(start_s, end_s, place, lift_m))


@dataclass(frozen=True, eq=False)
class FootTrack:
    """A foot over time."""

    targets: FootTargets
    load: Floats
    """(N,) 1 while it stands, 0 in the air, with soft transitions: how much of the weight it can take."""
    yaw: Floats
    """(N,) radians, going on beyond a full turn."""
    support_xy_m: Floats
    """(N, 2) the place on the floor over which the weight is borne: below the ankle of a level foot, or the
    ball of a raised one."""


def track_foot(time_s: Floats, foot: Foot, roll: SoleRoll, heel_rise: Floats, hop_m: Floats) -> FootTrack:
    """The foot at (N,) times in equal steps.

    heel_rise (N,): a rise onto the ball of the foot in radians beside that of the steps. hop_m (N,): how high
    the whole body is over the floor.
    """
    place, pitch = foot.first, heel_rise.copy()
    xyw = np.tile([place.x_m, place.y_m, place.yaw], (len(time_s), 1))
    lift_m, load = np.zeros(len(time_s)), np.ones(len(time_s))
    for move in foot.moves:
        done = np.clip((time_s - move.start_s) / (move.end_s - move.start_s), 0.0, 1.0)
        xyw += _way(place, move.place, min_jerk(done), roll.ball_m if move.lift_m == 0 else 0.0)
        stride_m, place = hypot(move.place.x_m - place.x_m, move.place.y_m - place.y_m), move.place
        if move.lift_m > 0:
            lift_m += move.lift_m * np.sin(pi * done) ** 2
            load[(done > 0) & (done < 1)] = 0.0
            pitch += _step_pitch(time_s, move, stride_m)
    yaw = xyw[:, 2]
    targets = roll.targets(xyw[:, :2], yaw, pitch, lift_m + hop_m)
    on_ball_m = roll.ball_m * np.clip(heel_rise / ON_BALL, 0.0, 1.0)
    support_xy_m = xyw[:, :2] + on_ball_m[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)])
    # The weight goes over before a foot lifts and after it lands, as fast as people shift it.
    soft = gaussian_filter1d(load, 0.09 / float(time_s[1] - time_s[0]), mode="nearest", truncate=3.0)
    return FootTrack(targets, soft, yaw, support_xy_m)


def _way(start: Place, end: Place, done: Floats, about_m: float) -> Floats:
    """(N, 3) how far x, y and yaw have come from start to end, (N,) done from 0 to 1.

    The point about_m ahead of the ankle goes straight there, the ankle turns about it.
    """
    yaw = start.yaw + (end.yaw - start.yaw) * done
    x_m, y_m = (
        (b - a) * done + about_m * ((1 - done) * turn(start.yaw) + done * turn(end.yaw) - turn(yaw))
        for a, b, turn in ((start.x_m, end.x_m, np.cos), (start.y_m, end.y_m, np.sin))
    )
    return np.column_stack([x_m, y_m, yaw - start.yaw])


def _step_pitch(time_s: Floats, move: Move, stride_m: float) -> Floats:
    """The foot's pitch (N,) around a step: the heel rises as the foot lifts, the toes as it lands."""
    size, swing_s = 0.35 + 0.65 * min(1.0, stride_m / _FULL_STRIDE_M), move.end_s - move.start_s
    before_s = min(0.2, 0.5 * swing_s)
    heel = bump(time_s, move.start_s - before_s, move.start_s, move.start_s + 0.5 * swing_s)
    toes = bump(time_s, move.end_s - 0.4 * swing_s, move.end_s, move.end_s + 0.15)
    return size * (_HEEL_RISE * heel - _TOE_RISE * toes)
