"""The synthetic actor's motion: an A pose, a walk on a circle, the arms raised, a turn on the spot.

Feet are planned first (gait), then the pelvis as high as both legs reach, then the legs by inverse
kinematics (legs); the arms and the head move along.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, Side
from services.mocap.synth.gait import Path, SoleRoll, Step, foot_targets, make_steps, min_jerk
from services.mocap.synth.legs import FootTargets, put_feet, reach_m
from services.mocap.synth.upper_body import Arms, Stride, upper_body
from services.mocap.types import Floats

STAND_S = 0.7
"""How long the actor stands in the A pose at the beginning."""
SHORTEST_S = 2.0
"""The whole motion takes at least this long; a shorter take shows its beginning."""
MAX_JOINT_SPEED_RAD_S = 9.0
"""No joint turns faster about any of its axes."""

_CIRCLE_M = 0.7
_SPEED_HEIGHTS_S = 0.57  # 1 m/s for someone 1.75 m tall
_TURN_RAD_S = 1.6
_RAMP_S = 0.45  # from standing to full speed
_STEP_S = 0.56
_DENSE_HZ = 240  # at least: path and pelvis are planned on a grid as fine as this
_LEAD_S = 0.2  # from the end of the A pose to the first step, whose heel rises before
_LAST_STEP_S = 0.35
_BEND = 0.997  # of the straight leg's length: knees are never locked


@dataclass(frozen=True)
class _Timeline:
    """When the sections begin and end, in seconds."""

    walk_s: float
    raise_s: float
    turn_s: float
    end_s: float

    @classmethod
    def of(cls, duration_s: float) -> "_Timeline":
        rest_s = duration_s - STAND_S
        return cls(STAND_S, STAND_S + 0.56 * rest_s, STAND_S + 0.78 * rest_s, duration_s)


def walk(n_frames: int, fps: float, body: Body) -> Floats:
    """Poses (n_frames, D) of the whole motion, fitted into n_frames / fps seconds but no less than 2.

    It starts at (0, -0.7) m facing +x and walks around the origin. Where time is short, movements get
    smaller, not faster. The lowest vertex of every frame touches the floor z = 0.
    """
    timeline = _Timeline.of(max(n_frames / fps, SHORTEST_S))
    substeps = ceil(_DENSE_HZ / fps)
    time_s = np.arange(ceil((timeline.end_s + 0.5) * fps) * substeps) / (fps * substeps)
    hip_m = float(body.offsets_m[JOINT_INDEX["left_hip"], 1])
    walking = make_steps(timeline.walk_s + _LEAD_S, timeline.raise_s, _STEP_S, "left", 0.7 * hip_m)
    turning = make_steps(timeline.turn_s, timeline.end_s, _STEP_S, "left", 0.9 * hip_m)
    path, roll = _plan_path(time_s, walking, turning, body.height_m), SoleRoll(body)
    feet: dict[Side, FootTargets] = {
        side: foot_targets(time_s, path, walking + turning, roll, side, 1.4 * hip_m) for side in SIDES
    }
    # The arms begin to go up while the last step closes the feet.
    arms = Arms(timeline.walk_s, timeline.raise_s - _LAST_STEP_S, timeline.turn_s, timeline.end_s)
    poses = upper_body(path, Stride.of(time_s, walking), Stride.of(time_s, turning), arms)
    poses[:, DOF_INDEX["root_z"]] = _pelvis_z_m(poses, body, feet, round(fps * substeps))
    frames = np.arange(n_frames, dtype=np.int32) * substeps
    return _touch_floor(put_feet(poses[frames], body.offsets_m, {s: feet[s].at(frames) for s in SIDES}), body)


def _plan_path(time_s: Floats, walking: list[Step], turning: list[Step], height_m: float) -> Path:
    """Around the circle during the walk, about the own axis during the turn."""
    along = _travel(time_s, walking, _SPEED_HEIGHTS_S * height_m / _CIRCLE_M)
    return Path(_CIRCLE_M, time_s, np.stack([along, _travel(time_s, turning, _TURN_RAD_S)], axis=1))


def _travel(time_s: Floats, steps: list[Step], cruise: float) -> Floats:
    """The way made (N,) at a cruising speed, with soft start and stop; it ends when the last step begins."""
    start_s, end_s = steps[0].start_s + 0.3 * steps[0].period_s, steps[-1].start_s
    ramp_s = min(_RAMP_S, (end_s - start_s) / 2)
    speed = min_jerk((time_s - start_s) / ramp_s) - min_jerk((time_s - end_s + ramp_s) / ramp_s)
    way: Floats = cumulative_trapezoid(speed, time_s, initial=0.0) * cruise * ramp_s / _RAMP_S
    return way


def _pelvis_z_m(poses: Floats, body: Body, feet: dict[Side, FootTargets], rate_hz: int) -> Floats:
    """The root's height (N,): as high as both legs reach at that time and around it, smoothed from below."""
    hips_m = joint_transforms(poses, body.offsets_m)[:, :, :3, 3]
    ceilings_m = []
    for side, foot in feet.items():
        way_m = foot.ankle_world_m - hips_m[:, JOINT_INDEX[f"{side}_hip"]]
        reach2 = (_BEND * reach_m(body.offsets_m, side)) ** 2 - (way_m[:, :2] ** 2).sum(axis=1)
        ceilings_m.append(poses[:, DOF_INDEX["root_z"]] + way_m[:, 2] + np.sqrt(np.maximum(reach2, 0.0)))
    radius = rate_hz // 10
    lowest_m = minimum_filter1d(np.minimum(*ceilings_m), 2 * radius + 1, mode="nearest")
    smooth_m: Floats = gaussian_filter1d(lowest_m, radius / 3, mode="nearest", truncate=3.0)
    return smooth_m


def _touch_floor(poses: Floats, body: Body) -> Floats:
    """Put the lowest vertex of each pose on the floor, from which the plan of the feet is a hair off."""
    for pose in poses:
        pose[DOF_INDEX["root_z"]] -= body.lowest_point_m(pose)
    return poses
