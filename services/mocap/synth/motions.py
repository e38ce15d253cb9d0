"""The motions that the synthetic studio can be asked for: some by name, and any BVH file.

For a file the actor takes an A pose first, as in every studio, then performs the file's motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, SIDES
from services.mocap.errors import UserError
from services.mocap.synth.bvh_file import BvhMotion, read_bvh
from services.mocap.synth.choreography import A_POSE
from services.mocap.synth.gait import min_jerk
from services.mocap.synth.rest_pose import RestPose, read_rest_pose, scale_m
from services.mocap.synth.retarget import joint_errors_m, retarget
from services.mocap.synth.rounds import ROUND_S, basic, dance
from services.mocap.synth.walk import STAND_S, walk
from services.mocap.types import Floats

_BLEND_S = 0.7
"""How long it takes from the A pose into the motion, which goes on meanwhile."""
_NEAR_FLOOR_M = 0.05
_FASTEST_M_S = 25.0
"""No joint is this fast: a first frame that is so far from the second one is a calibration pose."""


@dataclass(frozen=True, eq=False)
class Performance:
    """What the actor does."""

    poses: Floats
    """(N, D)"""
    joint_error_m: float | None = None
    """Of a BVH file: mean distance of the joints from the file's, had it the actor's bone lengths."""


def perform_bvh(path: Path, n_frames: int | None, start_s: float, fps: float, body: Body) -> Performance:
    """A file's motion from a time on, after STAND_S in the A pose; all that is left where n_frames is None.

    The middle of its way over the floor comes to the origin; the feet come to stand on the floor. Raises
    UserError where the file cannot be worked with or does not last that long.
    """
    motion = read_bvh(path)
    rest = read_rest_pose(motion, path)
    start_s += _calibration_s(motion, rest, body)
    left_s = motion.duration_s - start_s
    longest = int((left_s + STAND_S) * fps + 1e-6) + 1
    n = longest if n_frames is None else n_frames
    if left_s < 0 or n > longest:
        raise UserError(
            f"{path}: lasts {motion.duration_s:.2f} s: expected a start within it and, from there, at most"
            f" {max(longest, 0)} frames at {fps:g} per second, found {start_s:g} s and {n} frames"
        )
    times_s = np.arange(n) / fps - STAND_S  # of the motion; before it the actor stands
    places, R = motion.sample(start_s + np.maximum(times_s, 0.0))
    moving = slice(int(np.count_nonzero(times_s < 0)), None)
    moved = retarget(places[moving], R[moving], rest, body) if times_s[-1] >= 0 else np.empty((0, N_DOF))
    error_m = joint_errors_m(places[moving], R[moving], rest, moved, body).mean() if len(moved) else 0.0
    moved = _on_floor(moved, body, fps)
    poses = _from_a_pose(moved, times_s, body)
    middle_m = (poses[:, :2].min(axis=0) + poses[:, :2].max(axis=0)) / 2
    poses[:, :2] -= middle_m
    return Performance(poses, float(error_m))


def _calibration_s(motion: BvhMotion, rest: RestPose, body: Body) -> float:
    """How much of the beginning to leave out: one frame, where it is a calibration pose apart."""
    if len(motion.positions_local) < 3:
        return 0.0
    places, _ = motion.sample(np.array([0.0, 1.0, 2.0]) * motion.frame_s)
    way_m = scale_m(rest, body) * np.linalg.norm(
        np.diff(places[:, list(rest.columns.values())], axis=0), axis=2
    )
    first_m, second_m = way_m.max(axis=1)
    apart = first_m > max(_FASTEST_M_S * motion.frame_s, 5.0 * second_m)
    return motion.frame_s if apart else 0.0


def _on_floor(poses: Floats, body: Body, fps: float) -> Floats:
    """Lift or lower the motion so that what is lowest stands on the floor, slowly, and leaps stay leaps."""
    if not len(poses):
        return poses
    lowest_m = np.array([body.lowest_point_m(pose) for pose in poses])
    lowest_m -= (base_m := float(np.median(lowest_m)))
    near = np.flatnonzero(np.abs(lowest_m) < _NEAR_FLOOR_M)
    along_m = np.interp(np.arange(len(poses)), near, lowest_m[near]) if len(near) else np.zeros(len(poses))
    poses = poses.copy()
    poses[:, DOF_INDEX["root_z"]] -= base_m + gaussian_filter1d(along_m, max(0.1 * fps, 0.5), mode="nearest")
    return poses


def _from_a_pose(moved: Floats, times_s: Floats, body: Body) -> Floats:
    """The A pose where the motion begins, for the times before 0, then over into the motion."""
    standing = np.zeros(moved.shape[1])
    for name, angle in {**A_POSE.channels("left"), **A_POSE.channels("right")}.items():
        standing[DOF_INDEX[name]] = np.radians(angle)
    for side in SIDES:
        standing[DOF_INDEX[f"{side}_hip_abduction"]] = np.radians(2)
    if len(moved):
        standing[:4] = moved[0, :4]
    standing[DOF_INDEX["root_z"]] -= body.lowest_point_m(standing)
    poses = np.concatenate([np.tile(standing, (len(times_s) - len(moved), 1)), moved])
    share = min_jerk(times_s / _BLEND_S)
    for n in np.flatnonzero((times_s >= 0) & (share < 1)):
        poses[n] = standing + share[n] * (poses[n] - standing)
        lowest_m = body.lowest_point_m(poses[n])  # the legs of two poses mixed may reach below the floor
        poses[n, DOF_INDEX["root_z"]] -= lowest_m if lowest_m < 0 else (1.0 - share[n]) * lowest_m
    return poses


# Name -> how long it lasts unless asked otherwise, in seconds, and the function that makes its poses.
_MOTIONS: dict[str, tuple[float, Callable[[int, float, Body, int], Floats]]] = {
    "walk": (4.0, lambda n_frames, fps, body, _seed: walk(n_frames, fps, body)),
    "basic": (ROUND_S, basic),
    "dance": (ROUND_S, dance),
}


def make_motion(
    name: str, n_frames: int | None, fps: float, body: Body, seed: int, start_s: float = 0.0
) -> Performance:
    """The motion of a name or a BVH file, as long as it lasts by itself where n_frames is None.

    It begins with walk.STAND_S in the A pose. start_s: how much of a file's beginning to leave out. Raises
    UserError for a name that is not known and for a file that cannot be worked with.
    """
    if Path(name).suffix.lower() == ".bvh":
        return perform_bvh(Path(name), n_frames, start_s, fps, body)
    if name not in _MOTIONS:
        raise UserError(f"synth: motion = {name}: expected {', '.join(_MOTIONS)} or a file that ends in .bvh")
    if start_s:
        raise UserError(f"synth: start = {start_s:g}: expected 0, since {name} is not a BVH file")
    seconds, make = _MOTIONS[name]
    return Performance(make(n_frames or round(seconds * fps), fps, body, seed))
