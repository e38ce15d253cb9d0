"""Measured points of the scene: their table, cameras placed by them, calibrations moved to their world."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.calibration.rigid_transform import RigidTransform, in_world
from services.mocap.calibration.sightings import is_spread
from services.mocap.camera.camera import Camera, nearest_to_rays_m
from services.mocap.camera.undistort import undistorted_px
from services.mocap.errors import CalibrationError, nearest
from services.mocap.take.csv_columns import read_columns
from services.mocap.types import Floats, Ints

_COLUMNS = ("camera", "u", "v", "x", "y", "z")
_FEWEST_SEEN, _FEWEST_SHARED = 4, 3
"""Points that place one camera, and points in two or more pictures that place a world."""
_WRONG_RATIO, _WRONG_PX, _WRONG_M = 4.0, 5.0, 0.02
"""A point that is off by more than the others' median, times this, and by more than this, is named."""


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """Measured points in pictures, one row for each point in a camera's picture."""

    path: Path
    cameras: tuple[str, ...]
    """(N,) names."""
    points_px: Floats
    """(N, 2) in the raw picture, pixel centres at whole coordinates."""
    points_world_m: Floats
    """(N, 3) in the z-up world. Rows with equal coordinates are of the same point."""
    lines: tuple[int, ...]
    """(N,) of the file."""


def read_points(path: Path, names: Sequence[str] | None = None) -> ScenePoints:
    """Read a table with the columns camera, u, v (pixels) and x, y, z (metres); raises TakeError.

    names: the cameras that may be named in it, if they are known.
    """
    table = read_columns(path, _COLUMNS, allow_extra=True)
    cameras = tuple(cell.strip() for cell in table.cells["camera"])
    for name, line in zip(cameras, table.lines, strict=True):
        if names is not None and name not in names:
            raise CalibrationError(f"{path}: line {line}: camera: unknown {name}: {nearest(name, names)}")
    u, v, *xyz = (table.numbers(column) for column in _COLUMNS[1:])
    return ScenePoints(path, cameras, np.stack([u, v], 1), np.stack(xyz, 1), tuple(table.lines))


@dataclass(frozen=True, eq=False)
class Placed:
    """Cameras in the world of measured points."""

    cameras: tuple[Camera, ...]
    errors_mm: Floats
    """(N,) distance of each measured point from where the cameras see it; of cameras placed one by one, the
    distance of its ray."""
    scale: float
    """The cameras' lengths over the measured ones; 1 for cameras that were placed one by one."""
    remarks: tuple[str, ...]


def placed_one_by_one(lenses: Sequence[Camera], points: ScenePoints) -> Placed:
    """The poses of cameras with known lenses, each by the points in its picture alone.

    Raises CalibrationError if a camera has fewer than four points, or they lie on one line.
    """
    cameras, remarks, errors_mm = [], list[str](), np.zeros(len(points.lines))
    for lens in lenses:
        rows = np.flatnonzero(np.array(points.cameras) == lens.name).astype(np.int32)
        seen_m = points.points_world_m[rows]
        if len(rows) < _FEWEST_SEEN or not is_spread(seen_m):
            raise CalibrationError(
                f"{points.path}: {lens.name}: has {len(rows)} points: expected {_FEWEST_SEEN} or more "
                "that are not on one line, better six that are not on one plane"
            )
        pixels = undistorted_px(lens, points.points_px[rows])
        camera = _pose_of(lens, seen_m, pixels, points.path)
        off_px = np.linalg.norm(camera.project_px(seen_m) - pixels, axis=1)
        depth_m = seen_m @ camera.R_camera_world[2] + camera.t_camera_world_m[2]
        errors_mm[rows] = 1e3 * off_px * depth_m / camera.K[0, 0]
        remarks += _wrong_row(points, rows, off_px, _WRONG_PX, "px")
        cameras.append(camera)
    return Placed(tuple(cameras), errors_mm, 1.0, tuple(remarks))


def moved_to_points(cameras: Sequence[Camera], points: ScenePoints) -> Placed:
    """Calibrated cameras in the world of measured points, by a rigid motion: lengths stay as they are.

    Raises CalibrationError if fewer than three points are in two cameras' pictures, or these lie on one line.
    """
    _, first, point = np.unique(points.points_world_m, axis=0, return_index=True, return_inverse=True)
    point = point.ravel()
    told = [np.flatnonzero(point == p).astype(np.int32) for p in range(len(first))]
    shared = [rows for rows in told if len({points.cameras[row] for row in rows}) > 1]
    measured_m = np.array([points.points_world_m[rows[0]] for rows in shared]).reshape(-1, 3)
    if len(shared) < _FEWEST_SHARED or not is_spread(measured_m):
        raise CalibrationError(
            f"{points.path}: {len(shared)} points are in two or more cameras' pictures: expected "
            f"{_FEWEST_SHARED} or more that are not on one line, with equal x, y, z in all their rows"
        )
    by_name = {camera.name: camera for camera in cameras}
    seen_m = np.array([_met(by_name, points, rows) for rows in shared])
    centre_m, seen_centre_m = measured_m.mean(axis=0), seen_m.mean(axis=0)
    turn = Rotation.align_vectors(measured_m - centre_m, seen_m - seen_centre_m)[0].as_matrix()
    T_world_old = RigidTransform(turn, centre_m - turn @ seen_centre_m)
    off_m = np.linalg.norm(T_world_old.apply(seen_m) - measured_m, axis=1)
    spread_m = [float(np.linalg.norm(of - of.mean(axis=0))) for of in (seen_m, measured_m)]
    moved = [in_world(camera, T_world_old.inverse) for camera in cameras]
    rows = np.array([rows[0] for rows in shared])
    remarks = _wrong_row(points, rows, off_m, _WRONG_M, "m")
    return Placed(tuple(moved), 1e3 * off_m, spread_m[0] / spread_m[1], tuple(remarks))


def _pose_of(lens: Camera, points_m: Floats, pixels: Floats, path: Path) -> Camera:
    """A camera at the pose from which it sees points (N, 3) at undistorted pixels (N, 2)."""
    none = np.zeros(4)
    found, turn, shift = cv2.solvePnP(points_m, pixels, lens.K, none, flags=cv2.SOLVEPNP_SQPNP)
    if found:
        turn, shift = cv2.solvePnPRefineLM(points_m, pixels, lens.K, none, turn, shift)
        R = Rotation.from_rotvec(np.ravel(turn)).as_matrix()
        camera = replace(lens, R_camera_world=R, t_camera_world_m=np.ravel(shift).astype(np.float64))
        if np.isfinite(camera.project_px(points_m)).all():
            return camera
    raise CalibrationError(
        f"{path}: {lens.name}: its points fit no pose of the camera: check that each pixel is of its point"
    )


def _met(cameras: Mapping[str, Camera], points: ScenePoints, rows: Ints) -> Floats:
    """(3,) the point nearest to the rays of some rows."""
    seeing, pixels = [cameras[points.cameras[row]] for row in rows], points.points_px[rows, None]
    rays = [c.rays_world(undistorted_px(c, pixel))[0] for c, pixel in zip(seeing, pixels, strict=True)]
    return nearest_to_rays_m(np.array([c.centre_world_m for c in seeing]), np.array(rays))


def _wrong_row(points: ScenePoints, rows: Ints, off: Floats, least: float, unit: str) -> list[str]:
    """A remark on the worst of some rows if it is off by far more than the others."""
    worst = int(off.argmax())
    others = float(np.median(np.delete(off, worst)))
    if off[worst] <= max(least, _WRONG_RATIO * others):
        return []
    return [
        f"{points.path}: line {points.lines[rows[worst]]}: is {off[worst]:.2g} {unit} off, the others "
        f"{others:.2g} {unit} (median): check its pixel and its coordinates"
    ]
