"""The synthetic actor's motion: an A pose, a walk on a circle, the arms raised, a turn on the spot.

Feet are planned first (gait), then the pelvis as high as both legs reach, then the legs by inverse
kinematics (legs); the arms and the head move along.
"""

from math import ceil

import numpy as np
from scipy.integrate import cumulative_trapezoid

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES
from services.mocap.synth.gait import Path, SoleRoll, Step, foot_targets, make_steps, min_jerk
from services.mocap.synth.legs import hip_rise_m, put_feet, reach_m, smoothed_from_below
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


def walk(n_frames: int, fps: float, body: Body) -> Floats:
    """Poses (n_frames, 35) of the whole motion, fitted into n_frames / fps seconds but no less than 2.

    It starts at (0, -0.7) m facing +x and walks around the origin. Where time is short, movements get
    smaller, not faster. The lowest vertex of every frame touches the floor z = 0.
    """
    end_s = max(n_frames / fps, SHORTEST_S)
    walk_s, raise_s, turn_s = (STAND_S + share * (end_s - STAND_S) for share in (0.0, 0.56, 0.78))
    substeps = ceil(_DENSE_HZ / fps)
    time_s = np.arange(ceil((end_s + 0.5) * fps) * substeps) / (fps * substeps)
    hip_m = float(body.offsets_m[JOINT_INDEX["left_hip"], 1])
    walking = make_steps(walk_s + _LEAD_S, raise_s, _STEP_S, "left", 0.7 * hip_m)
    turning = make_steps(turn_s, end_s, _STEP_S, "left", 0.9 * hip_m)
    along = _travel(time_s, walking, _SPEED_HEIGHTS_S * body.height_m / _CIRCLE_M)
    path = Path(_CIRCLE_M, time_s, np.stack([along, _travel(time_s, turning, _TURN_RAD_S)], axis=1))
    roll = SoleRoll(body)
    feet = {side: foot_targets(time_s, path, walking + turning, roll, side, 1.4 * hip_m) for side in SIDES}
    # The arms begin to go up while the last step closes the feet.
    arms = Arms(walk_s, raise_s - _LAST_STEP_S, turn_s, end_s)
    poses = upper_body(path, Stride.of(time_s, walking), Stride.of(time_s, turning), arms)
    # The pelvis is as high as both legs reach at that time and around it.
    hips_m = joint_transforms(poses, body.offsets_m)[:, :, :3, 3]
    rises_m = [
        hip_rise_m(
            feet[side].ankle_world_m,
            hips_m[:, JOINT_INDEX[f"{side}_hip"]],
            _BEND * reach_m(body.offsets_m, side),
        )
        for side in SIDES
    ]
    z_m = poses[:, DOF_INDEX["root_z"]]
    z_m[:] = smoothed_from_below(z_m + np.minimum(*rises_m), round(fps * substeps) // 10)
    frames = np.arange(n_frames, dtype=np.int32) * substeps
    poses = put_feet(poses[frames], body.offsets_m, {side: feet[side].at(frames) for side in SIDES})
    for pose in poses:  # the plan of the feet is a hair off the floor
        pose[DOF_INDEX["root_z"]] -= body.lowest_point_m(pose)
    return poses


def _travel(time_s: Floats, steps: list[Step], cruise: float) -> Floats:
    """The way made (N,) at a cruising speed, with soft start and stop; it ends when the last step begins."""
    start_s, end_s = steps[0].start_s + 0.3 * steps[0].period_s, steps[-1].start_s
    ramp_s = min(_RAMP_S, (end_s - start_s) / 2)
    speed = min_jerk((time_s - start_s) / ramp_s) - min_jerk((time_s - end_s + ramp_s) / ramp_s)
    way: Floats = cumulative_trapezoid(speed, time_s, initial=0.0) * cruise * ramp_s / _RAMP_S
    return way
