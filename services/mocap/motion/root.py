"""The root's three angles as one rotation, and back without jumps; the same for any joint.

Heading, lean and pitch cannot be averaged one by one: near a lean of a quarter turn heading and pitch change
strongly in opposite directions while the body hardly rotates.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.types import Floats

ROOT_TURN = [DOF_INDEX[f"root_{name}"] for name in ("heading", "lean", "pitch")]
"""Indices into a pose of the angles that turn the root."""
_ORDER = "ZXY"  # heading, then about the new x, then about the new y
_GIMBAL_LOCK = 1e-7
"""Below this cosine of the middle angle only the sum or difference of the outer ones is defined."""


def root_rotations(poses: Floats) -> Rotation:
    """The rotations R_world_body of poses (N, D)."""
    return Rotation.from_euler(_ORDER, poses[:, ROOT_TURN])


def root_angles(rotations: Rotation, near: Floats) -> Floats:
    """Heading, lean and pitch (N, 3) of N rotations: of all equivalent angles those nearest to `near`.

    near: (N, 3). So a second full turn ends at 720°, and a lean continues beyond a quarter turn.
    """
    return nearest_angles(rotations.as_euler(_ORDER, suppress_warnings=True), near)


def nearest_angles(angles: Floats, near: Floats) -> Floats:
    """Of all angles (N, 3) that make the same rotations, those nearest to others (N, 3).

    Angles of turns about z, then the new x, then the new y.
    """
    z, x, y = angles.T
    # In gimbal lock only z + y (x = 90°) or z - y (x = -90°) is defined: keep y.
    y_shift = np.where(np.abs(np.cos(x)) < _GIMBAL_LOCK, near[:, 2] - y, 0.0)
    angles = np.column_stack([z - np.sign(x) * y_shift, x, y + y_shift])
    # Going over the pole (x past 90°, as a knee does) turns z and y by half a turn.
    candidates = np.stack([angles, np.pi + angles * [1.0, -1.0, 1.0]])
    candidates += 2 * np.pi * np.round((near - candidates) / (2 * np.pi))
    over_the_pole = np.argmin(np.sum((candidates - near) ** 2, axis=-1), axis=0)
    nearest: Floats = candidates[over_the_pole, np.arange(len(angles))]
    return nearest


def continuous_angles(R: Floats) -> Floats:
    """Angles (N, J, 3) of turns about z, then the new x, then the new y, of R (N, J, 3, 3), without jumps.

    Of all angles that make a frame's rotation, those nearest to the frame's before; the first, to zero.
    """
    n_frames, n_joints = R.shape[:2]
    angles: Floats = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_euler(_ORDER, suppress_warnings=True)
    angles = angles.reshape(n_frames, n_joints, 3)
    previous = np.zeros((n_joints, 3))
    for frame in range(n_frames):
        previous = angles[frame] = nearest_angles(angles[frame], previous)
    return angles


def without_flips(quaternions: Floats) -> Floats:
    """Quaternions (N, …, 4), each on the same side as the one before: q and -q are the same rotation."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0
    aligned = quaternions.copy()
    aligned[1:] *= np.where(np.cumsum(flips, axis=0) % 2, -1.0, 1.0)[..., None]
    return aligned
