"""What a choreographed motion is written in: arm poses, trunk, free legs and steps, beat by beat.

Movements are written once, with the left side leading; mirrored, the right one leads. Times in a movement are
beats from its beginning, angles are degrees, lengths are body heights.
"""

from collections import defaultdict
from dataclasses import dataclass, replace
from math import pi, radians

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from services.mocap.body.actor import Body
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, LOWER, SIDES, UPPER, Side
from services.mocap.synth.footwork import Foot, Place
from services.mocap.types import Floats

TOE_OUT = radians(9)
LIMIT_MARGIN = radians(2)
"""All keys of joints stay this far within the limits."""

BODY_CHANNELS = ("shift_ahead", "shift_left", "drop", "hop", "trunk_turn", "left_heel", "right_heel")
"""Channels beside the joints': the pelvis against its place over the feet, how far the knees give way (shares
of the leg's length), jumps, the trunk's turn against the feet, the rise of each heel."""
FREE = ("left_free", "right_free")
"""Channels: 1 where a leg in the air is posed by its joints, 0 where it goes where the footwork says."""
TURNED_BY_MIRROR = ("root_lean", "head_lean", "head_turn", "trunk_turn", "shift_left")
_SOFTEN_S = 0.05
"""Standard deviation of the smoothing that takes the kinks of acceleration out of the joined keys."""
_STANCE = 1.25  # of the hip's half width
_LIFT = 0.035


@dataclass(frozen=True)
class Arm:
    """A pose of an arm; elevation and forward swing from the T pose."""

    elevation: float
    forward: float
    elbow: float
    twist: float = 0.0

    def channels(self, side: Side) -> dict[str, float]:
        """The key's values by DOF name, in degrees."""
        return {
            f"{side}_shoulder_elevation": self.elevation,
            f"{side}_shoulder_forward": self.forward,
            f"{side}_shoulder_twist": self.twist,
            f"{side}_elbow_flexion": self.elbow,
            f"{side}_wrist_flexion": 6.0,
            f"{side}_wrist_deviation": 0.0,
        }


@dataclass(frozen=True)
class Leg:
    """A pose of a leg in the air."""

    flexion: float
    abduction: float
    knee: float
    twist: float = 0.0
    ankle: float = -25.0

    def channels(self, side: Side) -> dict[str, float]:
        """The key's values by DOF name, in degrees."""
        return {
            f"{side}_hip_flexion": self.flexion,
            f"{side}_hip_abduction": self.abduction,
            f"{side}_hip_twist": self.twist,
            f"{side}_knee_flexion": self.knee,
            f"{side}_ankle_flexion": self.ankle,
        }


A_POSE = Arm(-45, 0, 14)
HANGING = Arm(-78, 6, 14)
_LOOSE = Leg(10, 3, 20)


class Score:
    """Keys of named channels over time, joined smoothly; before all its keys a channel holds its first value,
    after them its last.

    Between keys a channel never leaves their range, so that keys within the joint limits make a motion within
    them.
    """

    def __init__(self, rest: dict[str, float]) -> None:
        """Begin at time 0 with a value for every channel there will be."""
        self._keys: dict[str, dict[float, float]] = defaultdict(dict)
        for channel, value in rest.items():
            self._keys[channel][0.0] = value

    def put(self, time_s: float, **values: float) -> None:
        """Set keys at one time, not before the channel's last one; a second key at that time replaces it."""
        for channel, value in values.items():
            keys = self._keys[channel]
            if time_s < max(keys):
                raise ValueError(f"{channel}: a key at {time_s:.3f} s after one at {max(keys):.3f} s")
            keys[time_s] = value

    def hold(self, time_s: float, *channels: str) -> None:
        """Keep channels at their last values until a time."""
        self.put(time_s, **{channel: self.last(channel) for channel in channels})

    def last(self, channel: str) -> float:
        """A channel's value at its last key."""
        return self._keys[channel][max(self._keys[channel])]

    def play(self, channel: str, time_s: Floats) -> Floats:
        """The channel's values at (N,) times in equal steps, smooth, within the range of its keys."""
        keys = self._keys[channel]
        first, *_, last = [0.0, *keys]
        # Held for a while on both sides, so that it leaves its first key and comes to its last one at rest.
        at_s = np.array([first - 1.0, *keys, last + 1.0])
        values = np.array([keys[first], *keys.values(), keys[last]])
        joined = PchipInterpolator(at_s, values)(np.clip(time_s, at_s[0], at_s[-1]))
        sigma = _SOFTEN_S / float(time_s[1] - time_s[0])
        smooth: Floats = gaussian_filter1d(joined, sigma, mode="nearest", truncate=3.0)
        return smooth


class Choreography:
    """A motion in the making: a score, two feet, and a clock that movements move on."""

    def __init__(self, body: Body) -> None:
        """Begin standing in the A pose at the origin, facing +x."""
        self.height_m = body.height_m
        self._apart_m = _STANCE * float(body.offsets_m[JOINT_INDEX["left_hip"], 1])
        rest = dict.fromkeys(("root_lean", "root_pitch", "head_pitch", "head_lean", "head_turn"), 0.0)
        rest |= dict.fromkeys(BODY_CHANNELS + FREE, 0.0)
        for side in SIDES:
            rest |= A_POSE.channels(side) | _LOOSE.channels(side)
        self.score = Score(rest)
        self._middle = Place(0.0, 0.0, 0.0)
        self.feet: dict[Side, Foot] = {side: Foot(side, self._stand(side)) for side in SIDES}
        self.now_s, self.tempo, self.mirrored = 0.0, 1.0, False

    def done(self, beats: float, arms: Arm | None = None) -> None:
        """End a movement, with both arms in a pose if one is given.

        Its last beat is the next one's first; channels keep their values until then.
        """
        self.put(beats, arms, arms)
        self.now_s += beats * self.tempo
        for side in SIDES:
            if self.score.last(f"{side}_free"):
                raise ValueError(f"a movement ends with its {side} leg in the air")

    def put(self, beat: float, left: Arm | None = None, right: Arm | None = None, /, **values: float) -> None:
        """Set keys of arms, left being the leading side, and of single channels, joints in degrees.

        Raises ValueError where a joint would come nearer to its limits than the margin.
        """
        for side, arm in zip(SIDES, (left, right), strict=True):
            values |= {} if arm is None else arm.channels(side)
        keys = {
            self._sided(name): -value if self.mirrored and name in TURNED_BY_MIRROR else value
            for name, value in values.items()
        }
        for name, value in keys.items():
            i = DOF_INDEX.get(name)
            if i is not None and not (LOWER[i] + LIMIT_MARGIN <= radians(value) <= UPPER[i] - LIMIT_MARGIN):
                raise ValueError(f"{name} = {value}: expected within the joint's limits with a margin")
        self.score.put(self._time_s(beat), **keys)

    def hold_arms(self, beat: float) -> None:
        """Keep both arms until a beat as their last keys say."""
        for side in SIDES:
            self.score.hold(self._time_s(beat), *HANGING.channels(side))

    def hold(self, beat: float, *channels: str) -> None:
        """Keep channels until a beat as their last keys say."""
        self.score.hold(self._time_s(beat), *(self._sided(channel) for channel in channels))

    def step(
        self, side: Side, beats: tuple[float, float], ahead: float = 0.0, out: float = 0.0, turn: float = 0.0,
        lift: float = _LIFT,
    ) -> None:  # fmt: skip
        """Step, with the leading side's foot (left) or the other, to a place beside where the dancer is.

        ahead, out: of the foot's place in the stance, to the side it is on. turn: degrees to the leading
        side, of the foot against where the dancer faces. lift: 0 turns on the ball of the foot.
        """
        real = _other(side) if self.mirrored else side
        sign = (1.0 if real == "left" else -1.0) * out * self.height_m
        lead = -1.0 if self.mirrored else 1.0
        stand = self._stand(real)
        moved = self._middle.ahead(ahead * self.height_m, sign)
        place = Place(stand.x_m + moved.x_m, stand.y_m + moved.y_m, stand.yaw + lead * radians(turn))
        self.feet[real].step(self._time_s(beats[0]), self._time_s(beats[1]), place, lift * self.height_m)

    def face(self, turn: float) -> None:
        """From now on steps count from another facing: turn in degrees to the leading side."""
        lead = -1.0 if self.mirrored else 1.0
        self._middle = replace(self._middle, yaw=self._middle.yaw + lead * turn * pi / 180)

    def free_leg(self, side: Side, beats: tuple[float, float], *poses: Leg, soft: float = 0.4) -> None:
        """Pose a leg that is in the air for some beats: on the way up, through the poses, down again.

        soft: the share of the beats that going up and coming down take each.
        """
        start, end = beats
        rise = (end - start) * soft
        self.put(start, **{f"{side}_free": 0.0}, **poses[0].channels(side))
        held = poses if len(poses) > 1 else poses * 2
        for beat, pose in zip(np.linspace(start + rise, end - rise, len(held)), held, strict=True):
            self.put(float(beat), **{f"{side}_free": 1.0}, **pose.channels(side))
        self.put(end, **{f"{side}_free": 0.0}, **poses[-1].channels(side))

    def _stand(self, side: Side) -> Place:
        sign = 1.0 if side == "left" else -1.0
        return self._middle.ahead(0.0, sign * self._apart_m, sign * TOE_OUT)

    def _time_s(self, beat: float) -> float:
        return self.now_s + beat * self.tempo

    def _sided(self, name: str) -> str:
        side, _, rest = name.partition("_")
        return f"{_other(side)}_{rest}" if self.mirrored and side in SIDES else name


def _other(side: str) -> Side:
    return "right" if side == "left" else "left"


def turn_in_steps(c: Choreography, start: float, end: float, n: int, lift: float) -> None:
    """One full turn on the spot to the leading side between two beats, in n steps and a last one to close.

    Each foot goes one n-th of the turn beyond the other one.
    """
    each = (end - start) / (n + 1)
    for i in range(n + 1):
        if i < n:
            c.face(turn=360.0 / n)
        c.step(SIDES[i % 2], (start + i * each, start + (i + 0.9) * each), lift=lift)
