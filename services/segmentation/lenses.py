"""Where points of the world lie in raw pictures, lens distortion included, and where raw pixels look."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import undistorted_px, undistortion_maps
from services.mocap.types import Floats, Ints

Pixels: TypeAlias = NDArray[np.int16]

NOWHERE = -1
"""Column and row for points outside the raw picture."""


@dataclass(frozen=True, eq=False)
class Lenses:
    """The projections of several cameras to the pixels of their raw pictures."""

    P_px_world: Floats
    """(C, 3, 4) to pixels of the undistorted pictures."""
    sizes_px: Ints
    """(C, 2) width and height."""
    raw_px: Pixels
    """(C, H, W, 2) column and row in the raw picture for each undistorted pixel; NOWHERE outside it."""

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> "Lenses":
        """The lenses of some cameras, whose pictures may be of different sizes."""
        sizes_px = np.array([camera.size_px for camera in cameras], np.int32)
        width, height = sizes_px.max(axis=0)
        raw_px = np.full((len(cameras), height, width, 2), NOWHERE, np.int16)
        for c, camera in enumerate(cameras):
            raw = np.rint(np.stack(undistortion_maps(camera, cv2.CV_32FC1), axis=-1))
            raw[~np.all((raw >= 0) & (raw < camera.size_px), axis=-1)] = NOWHERE
            raw_px[c, : camera.height_px, : camera.width_px] = raw
        return cls(np.array([camera.P_px_world for camera in cameras]), sizes_px, raw_px)

    def project(self, points_m: Floats) -> Pixels:
        """(C, …, 2) column and row of points (…, 3) in each raw picture; NOWHERE if outside."""
        pixels = np.empty((len(self.P_px_world), *points_m.shape[:-1], 2), np.int16)
        flat = pixels.reshape(len(pixels), -1, 2)
        _project(self.P_px_world, self.sizes_px, self.raw_px, points_m.reshape(-1, 3), flat)
        return pixels


def rays_of(camera: Camera) -> tuple[Floats, Floats]:
    """A camera's centre (3,) in the world, and the rays (H, W, 3) of its raw pixels."""
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    raw = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float64)
    flat = undistorted_px(camera, raw, np.eye(3))
    rays = np.column_stack([flat, np.ones(len(flat))]) @ camera.R_camera_world
    return camera.centre_world_m, rays.reshape(*camera.shape_px, 3)


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def raw_pixel(P: Floats, size_px: Ints, raw_px: Pixels, x: float, y: float, z: float) -> tuple[int, int]:
    """Column and row of a world point, in metres, in one camera's raw picture; NOWHERE if outside."""
    across = P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]
    down = P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]
    return raw_of(across, down, P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3], size_px, raw_px)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project(P_px_world: Floats, sizes_px: Ints, raw_px: Pixels, points_m: Floats, pixels: Pixels) -> None:
    for c in range(len(P_px_world)):
        for i, (x, y, z) in enumerate(points_m):
            pixels[c, i] = raw_pixel(P_px_world[c], sizes_px[c], raw_px[c], x, y, z)


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def raw_of(across: float, down: float, depth_m: float, size_px: Ints, raw_px: Pixels) -> tuple[int, int]:
    """Column and row of a direction in one camera's raw picture; NOWHERE if outside.

    across, down: column and row in the undistorted picture, both times the depth.
    """
    if depth_m < 0.1:
        return NOWHERE, NOWHERE
    nearness = 1.0 / depth_m
    u, v = across * nearness + 0.5, down * nearness + 0.5
    if not (u >= 0 and v >= 0 and u < size_px[0] and v < size_px[1]):
        return NOWHERE, NOWHERE
    column, row = int(u), int(v)
    return raw_px[row, column, 0], raw_px[row, column, 1]
