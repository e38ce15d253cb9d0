"""Other conventions for a camera's extrinsics, in which a calibration may be meant."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from services.mocap.camera.calibration import Up
from services.mocap.camera.camera import R_ZUP_YUP, Camera
from services.mocap.types import Floats


def upward(cameras: Sequence[Camera]) -> float:
    """Median cosine between the cameras' upward directions and the world's."""
    return float(np.median([-camera.R_camera_world[1, 2] for camera in cameras]))


def inverted(camera: Camera, up: Up) -> Camera:
    """The camera whose extrinsics, as its file has them, lead from the camera to the world."""
    R_file_internal = R_ZUP_YUP.T if up == "y" else np.eye(3)
    R = camera.R_camera_world @ R_file_internal.T
    inverse = replace(camera, R_camera_world=R.T, t_camera_world_m=-R.T @ camera.t_camera_world_m)
    return inverse.with_world_turned(R_file_internal.T)


def opengl(camera: Camera, _: Up) -> Camera:
    """The camera whose own axes are OpenGL's: y up, z backward."""
    return with_axes(camera, OPENGL_AXES)


def with_axes(camera: Camera, turn: Floats) -> Camera:
    """A camera at the same place with other axes of its own: turn @ x_camera."""
    R, t_m = turn @ camera.R_camera_world, turn @ camera.t_camera_world_m
    return replace(camera, R_camera_world=R, t_camera_world_m=t_m)


BEHIND = np.diag([-1.0, 1.0, -1.0])
OPENGL_AXES = np.diag([1.0, -1.0, -1.0])
CONVENTIONS: dict[str, Callable[[Camera, Up], Camera]] = {
    "the way from the camera to the world": inverted,
    "OpenGL's axes, y up and z backward": opengl,
    "Blender's matrix_world, from the camera to the world with y up and z backward": lambda camera, up: (
        opengl(inverted(camera, up), up)
    ),
}
"""How extrinsics may be meant instead."""
