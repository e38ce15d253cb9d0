"""The cameras of the synthetic studio: a ring around a stage, as in a real one.

Distances, heights, focal lengths and principal points vary from camera to camera, always the same way.
"""

from math import pi

import numpy as np
from scipy.optimize import brentq

from services.mocap.camera.camera import Camera
from services.mocap.types import Floats

STAGE_RADIUS_M = 1.6
"""Everything an actor does within this distance of the world's origin is in every picture, unless a studio is
made larger, …"""
STAGE_HEIGHT_M = 2.2
"""… up to this height: the raised hands of someone 1.75 m tall."""

_MARGIN = 0.02  # of the picture's width, left free on every side of the stage


def studio_cameras(
    n: int = 8,
    width_px: int = 320,
    height_px: int = 240,
    stage_radius_m: float = STAGE_RADIUS_M,
    stage_height_m: float = STAGE_HEIGHT_M,
) -> tuple[Camera, ...]:
    """`n` pinhole cameras cam01, cam02, … (without lens distortion) in a ring, all seeing the whole stage.

    They stand 3.8 to 4.4 m from the stage's vertical axis, farther away around a larger stage, and 1.2 to
    2.4 m high. Raises ValueError when there is no camera or a picture is smaller than 32 pixels on a side.
    """
    if n < 1 or min(width_px, height_px) < 32:
        raise ValueError(
            f"studio: expected at least 1 camera of 32x32 pixels or more, got {n} of {width_px}x{height_px}"
        )
    rng = np.random.default_rng(2003)  # one studio, the same in every take
    stage_world_m = _stage_rim_world_m(stage_radius_m, stage_height_m)
    cameras = []
    for i in range(n):
        azimuth = 2 * pi * (i + 0.5 + rng.uniform(-0.15, 0.15)) / n
        distance_m = rng.uniform(3.8, 4.4) * stage_radius_m / STAGE_RADIUS_M
        height_m = rng.uniform(1.2, 2.4)
        centre_world_m = np.array([distance_m * np.cos(azimuth), distance_m * np.sin(azimuth), height_m])
        aim_z_m = _balancing_aim_z_m(centre_world_m, stage_world_m)
        R_camera_world = _looking_at(centre_world_m, np.array([0.0, 0.0, aim_z_m]))
        principal_px = np.array([width_px - 1, height_px - 1]) / 2 + width_px * rng.uniform(-0.005, 0.005, 2)
        rays = _normalised((stage_world_m - centre_world_m) @ R_camera_world.T)
        room_px = np.minimum(principal_px, [width_px - 1, height_px - 1] - principal_px) - _MARGIN * width_px
        focal_px = rng.uniform(0.94, 1.0) * float((room_px / np.abs(rays).max(axis=0)).min())
        cameras.append(
            Camera(
                name=f"cam{i + 1:02d}",
                width_px=width_px,
                height_px=height_px,
                K=np.array(
                    [[focal_px, 0.0, principal_px[0]], [0.0, focal_px, principal_px[1]], [0.0, 0.0, 1.0]]
                ),
                distortion=np.zeros(4),
                R_camera_world=R_camera_world,
                t_camera_world_m=-R_camera_world @ centre_world_m,
            )
        )
    return tuple(cameras)


def _stage_rim_world_m(radius_m: float, height_m: float) -> Floats:
    """(128, 3) points around the bottom and the top of the stage, close to its convex hull."""
    angle = np.linspace(0.0, 2 * pi, 64, endpoint=False)
    rim = radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.column_stack([rim, np.full(64, z)]) for z in (0.0, height_m)])


def _balancing_aim_z_m(centre_world_m: Floats, stage_world_m: Floats) -> float:
    """The height on the stage's axis to look at, so that as much is free over the stage as below it."""

    def imbalance(aim_z_m: float) -> float:
        R_camera_world = _looking_at(centre_world_m, np.array([0.0, 0.0, aim_z_m]))
        y = _normalised((stage_world_m - centre_world_m) @ R_camera_world.T)[:, 1]
        return float(y.max() + y.min())

    return float(brentq(imbalance, -STAGE_HEIGHT_M, 2 * STAGE_HEIGHT_M, xtol=1e-6))


def _looking_at(centre_world_m: Floats, target_world_m: Floats) -> Floats:
    """R_camera_world (3, 3) of an upright camera: x to the right, y down, z towards the target."""
    forward = target_world_m - centre_world_m
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def _normalised(points_camera_m: Floats) -> Floats:
    """(N, 3) points in front of a camera to (N, 2) picture coordinates at focal length 1."""
    return points_camera_m[:, :2] / points_camera_m[:, 2:]
