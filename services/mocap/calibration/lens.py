"""Lens models for many points at once, as OpenCV has them: what the bundle adjustment differentiates."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np

from services.mocap.types import Floats

Lens: TypeAlias = Literal["normal", "wide", "fisheye"]
"""normal: k1, k2, p1, p2. wide: k3 as well. fisheye: the four of OpenCV's fisheye model."""
N_COEFFICIENTS: dict[Lens, int] = {"normal": 4, "wide": 5, "fisheye": 4}
N_INTRINSICS = 9
"""fx, fy, cx, cy and five coefficients, of which those that a lens lacks stay zero."""
_NEAREST_M = 1e-3


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """One camera's lens."""

    lens: Lens
    size_px: tuple[int, int]
    values: Floats
    """(N_INTRINSICS,)"""

    @property
    def K(self) -> Floats:
        """(3, 3)"""
        fx, fy, cx, cy = self.values[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Floats:
        """(4,) or (5,)"""
        return self.values[4 : 4 + N_COEFFICIENTS[self.lens]].copy()

    @property
    def is_fisheye(self) -> bool:
        """Which of OpenCV's two models it is."""
        return self.lens == "fisheye"

    def normalised(self, points_px: Floats) -> Floats:
        """(n, 2) raw pixels to undistorted picture coordinates at focal length 1."""
        undistort = cv2.fisheye.undistortPoints if self.is_fisheye else cv2.undistortPoints
        return np.asarray(undistort(points_px[:, None], self.K, self.distortion), np.float64).reshape(-1, 2)


def project(points_camera_m: Floats, values: Floats, fisheye: bool) -> Floats:
    """(N, 3) points, each with its camera's intrinsics (N, 9), to raw pixels (N, 2).

    Points behind the camera are pushed before it, so that a step of a minimiser that puts them there fails
    by a large but finite error.
    """
    depth_m = np.maximum(points_camera_m[:, 2], _NEAREST_M)
    x, y = points_camera_m[:, 0] / depth_m, points_camera_m[:, 1] / depth_m
    fx, fy, cx, cy = values[:, :4].T
    u, v = _fisheye(x, y, values) if fisheye else _radial_tangential(x, y, values)
    return np.stack([fx * u + cx, fy * v + cy], axis=1)


def _radial_tangential(x: Floats, y: Floats, values: Floats) -> tuple[Floats, Floats]:
    k1, k2, p1, p2, k3 = values[:, 4:].T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xy = 2 * x * y
    return x * radial + p1 * xy + p2 * (r2 + 2 * x * x), y * radial + p2 * xy + p1 * (r2 + 2 * y * y)


def _fisheye(x: Floats, y: Floats, values: Floats) -> tuple[Floats, Floats]:
    r = np.hypot(x, y)
    angle = np.arctan(r)
    a2 = angle * angle
    k1, k2, k3, k4, _ = values[:, 4:].T
    bent = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
    scale = np.where(r > 1e-9, bent / np.maximum(r, 1e-9), 1.0)
    return x * scale, y * scale
