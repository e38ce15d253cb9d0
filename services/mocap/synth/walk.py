"""The synthetic actor's walk: an A pose, a walk on a circle, the arms raised, a turn on the spot.

Feet are planned first (gait), then the pelvis as high as both legs reach, then the legs by inverse
kinematics (legs); trunk, head and arms go along: sway and turn of the pelvis, arm swing, raised arms.
"""

from dataclasses import dataclass
from math import ceil, pi, radians

import numpy as np
from scipy.integrate import cumulative_trapezoid

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, Side
from services.mocap.synth.gait import Footstep, Path, SoleRoll, foot_targets, make_steps, min_jerk
from services.mocap.synth.legs import hip_rises_m, put_feet, set_ball_joint, smoothed_from_below
from services.mocap.types import Floats

_A_POSE, _HANGING, _RAISED = radians(45), radians(11), {"left": radians(165), "right": radians(152)}
_DROP_S = 0.6  # from the A pose to hanging arms
_RAISE_RAD_S = 5.0  # the arms go up no faster
_SWING, _SWING_BIAS = radians(23), radians(3)
_SWAY_M = 0.018

STAND_S = 0.7
"""How long the actor stands in the A pose at the beginning."""
SHORTEST_S = 2.0
"""The whole motion takes at least this long; a shorter take shows its beginning."""

_CIRCLE_M = 0.7
_SPEED_HEIGHTS_S = 0.57  # 1 m/s for someone 1.75 m tall
_TURN_RAD_S = 1.6
_RAMP_S = 0.45  # from standing to full speed
_STEP_S = 0.56
_DENSE_HZ = 240  # at least: path and pelvis are planned on a grid as fine as this
_LEAD_S = 0.2  # from the end of the A pose to the first step, whose heel rises before
_LAST_STEP_S = 0.35
_BEND = 0.997  # of the straight leg's length: knees are never locked


@dataclass(frozen=True, eq=False)
class Stride:
    """The rhythm of a row of steps."""

    activity: Floats
    """(N,) 0 while standing, 1 while stepping."""
    left_ahead: Floats
    """(N,) the left leg's lead, from -1 (right leg ahead) to 1, times the activity."""
    left_loaded: Floats
    """(N,) 1 in the middle of the left leg's stance, -1 in that of the right one, times the activity."""

    @classmethod
    def of(cls, time_s: Floats, steps: list[Footstep]) -> "Stride":
        """The rhythm at (N,) times of steps that the left leg begins."""
        start_s, end_s, period_s = steps[0].start_s, steps[-1].start_s + steps[-1].period_s, steps[0].period_s
        ramp_s = min(0.45, (end_s - start_s) / 2)
        activity = min_jerk((time_s - start_s) / ramp_s) - min_jerk((time_s - end_s + ramp_s) / ramp_s)
        phase = pi * (time_s - start_s) / period_s
        return cls(activity, -activity * np.cos(phase), -activity * np.sin(phase))


def _arm_abduction(
    time_s: Floats, side: Side, drop_s: float, raise_s: float, lower_s: float, end_s: float
) -> Floats:
    """An arm's angle (N,) from hanging straight down, sideways, in radians.

    drop_s, raise_s, lower_s, end_s: when it drops from the A pose, goes up, comes down, and is down.
    """
    up_s = 0.95 * (lower_s - raise_s)
    lift = min(_RAISED[side] - _HANGING, _RAISE_RAD_S * up_s / 1.875)
    up = min_jerk((time_s - raise_s) / up_s)
    down = min_jerk((time_s - lower_s) / max(0.8 * (end_s - lower_s), up_s))
    dropped = min_jerk((time_s - drop_s) / _DROP_S)
    return _A_POSE + (_HANGING - _A_POSE) * dropped + lift * (up - down)


def upper_body(path: Path, walking: Stride, turning: Stride, abductions: dict[Side, Floats]) -> Floats:
    """Poses (N, D) at the path's (N,) times with everything set but the root's height and the legs.

    abductions: (N,) of the arms, in radians.
    """
    poses = np.zeros((len(path.time_s), N_DOF))

    def put(name: str, values: Floats) -> None:
        poses[:, DOF_INDEX[name]] = values

    position_m, heading = path.place(path.turns)
    sway_m = _SWAY_M * (walking.left_loaded + turning.left_loaded)
    put("root_x", position_m[:, 0] - sway_m * np.sin(heading))
    put("root_y", position_m[:, 1] + sway_m * np.cos(heading))
    put("root_heading", heading - radians(4) * walking.left_ahead)
    put("root_lean", radians(-3) * walking.activity)  # into the curve, which bends to the left
    put("root_pitch", radians(3) * walking.activity)
    put("head_pitch", radians(-2) * walking.activity + radians(4) * turning.activity)
    put("head_lean", radians(2) * walking.activity)
    put(
        "head_turn",
        radians(9) * walking.activity + radians(4) * walking.left_ahead + radians(14) * turning.activity,
    )
    for side in SIDES:
        lead = (-1.0 if side == "left" else 1.0) * (walking.left_ahead + 0.3 * turning.left_ahead)
        forward = _SWING * lead + _SWING_BIAS * walking.activity
        _put_arm(poses, side, forward, abductions[side])
        put(f"{side}_elbow_flexion", radians(14) + radians(13) * lead + radians(8) * walking.activity)
        put(f"{side}_wrist_flexion", radians(6) + radians(5) * lead)
    return poses


def _put_arm(poses: Floats, side: Side, forward: Floats, abduction: Floats) -> None:
    """Point the upper arm (N,) radians forward of and away from hanging down, the elbow bending forward."""
    sign = 1.0 if side == "left" else -1.0
    zero = np.zeros_like(forward)
    # Hanging straight down and turned away from the body first, then swung about the lateral axis.
    along = sign * np.stack([zero, sign * np.sin(abduction), -np.cos(abduction)], axis=1)
    ahead = np.stack([zero + 1.0, zero, zero], axis=1)
    R_sideways = np.stack([ahead, along, np.cross(ahead, along)], axis=2)
    cosine, sine = np.cos(forward), np.sin(forward)
    R_forward = np.stack([cosine, zero, -sine, zero, zero + 1.0, zero, sine, zero, cosine], axis=1)
    set_ball_joint(poses, f"{side}_shoulder", R_forward.reshape(-1, 3, 3) @ R_sideways)


def walk(n_frames: int, fps: float, body: Body) -> Floats:
    """Poses (n_frames, D) of the whole motion, fitted into n_frames / fps seconds but no less than 2.

    It starts at (0, -0.7) m facing +x and walks around the origin. Where time is short, movements get
    smaller, not faster. The lowest vertex of every frame touches the floor z = 0.
    """
    end_s = max(n_frames / fps, SHORTEST_S)
    walk_s, raise_s, turn_s = (STAND_S + share * (end_s - STAND_S) for share in (0.0, 0.56, 0.78))
    substeps = ceil(_DENSE_HZ / fps)
    time_s = np.arange(ceil((end_s + 0.5) * fps) * substeps) / (fps * substeps)
    hip_m = float(body.offsets_m[JOINT_INDEX["left_hip"], 1])
    walking = make_steps(walk_s + _LEAD_S, raise_s, _STEP_S, 0.7 * hip_m)
    turning = make_steps(turn_s, end_s, _STEP_S, 0.9 * hip_m)
    along = _travel(time_s, walking, _SPEED_HEIGHTS_S * body.height_m / _CIRCLE_M)
    path = Path(_CIRCLE_M, time_s, np.stack([along, _travel(time_s, turning, _TURN_RAD_S)], axis=1))
    roll = SoleRoll(body)
    feet = {side: foot_targets(time_s, path, walking + turning, roll, side, 1.4 * hip_m) for side in SIDES}
    # The arms begin to go up while the last step closes the feet.
    arms = {s: _arm_abduction(time_s, s, walk_s, raise_s - _LAST_STEP_S, turn_s, end_s) for s in SIDES}
    poses = upper_body(path, Stride.of(time_s, walking), Stride.of(time_s, turning), arms)
    # The pelvis is as high as both legs reach at that time and around it.
    rises_m = hip_rises_m(poses, body.offsets_m, feet, _BEND)
    z_m = poses[:, DOF_INDEX["root_z"]]
    z_m[:] = smoothed_from_below(z_m + np.minimum(*rises_m.values()), round(fps * substeps) // 10)
    frames = np.arange(n_frames, dtype=np.int32) * substeps
    poses = put_feet(poses[frames], body.offsets_m, {side: feet[side].at(frames) for side in SIDES})
    for pose in poses:  # the plan of the feet is a hair off the floor
        pose[DOF_INDEX["root_z"]] -= body.lowest_point_m(pose)
    return poses


def _travel(time_s: Floats, steps: list[Footstep], cruise: float) -> Floats:
    """The way made (N,) at a cruising speed, with soft start and stop; it ends when the last step begins."""
    start_s, end_s = steps[0].start_s + 0.3 * steps[0].period_s, steps[-1].start_s
    ramp_s = min(_RAMP_S, (end_s - start_s) / 2)
    speed = min_jerk((time_s - start_s) / ramp_s) - min_jerk((time_s - end_s + ramp_s) / ramp_s)
    way: Floats = cumulative_trapezoid(speed, time_s, initial=0.0) * cruise * ramp_s / _RAMP_S
    return way
