"""`xormocap calibrate --points FILE`: the world by measured points of the scene."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.markup import escape

from services.commands.consoles import say, stdout, table_of, warn
from services.mocap.calibration.known_lenses import known_lenses
from services.mocap.calibration.placing import (
    ScenePoints,
    moved_to_points,
    placed_one_by_one,
    read_points,
)
from services.mocap.calibration.remarks import remarks_on
from services.mocap.calibration.rig_solving import camera_of
from services.mocap.calibration.rigid_transform import IDENTITY
from services.mocap.camera.calibration import Up, write_calibration
from services.mocap.camera.camera import Camera

_SCALE_OFF = 0.02
"""A calibration whose lengths differ by more from measured ones causes a warning."""


def place_by_points(file: Path, lens_file: Path, out: Path, up: Up) -> None:
    """Find the pose of each camera by measured points, with lenses of a calibration file; write the cameras.

    Raises UserError if a lens is missing or points do not determine a camera.
    """
    points = read_points(file)
    names = sorted(set(points.cameras))
    lenses = known_lenses(lens_file, names)
    points = read_points(file, list(lenses))
    placed = placed_one_by_one([camera_of(name, lenses[name], IDENTITY) for name in names], points)
    write_calibration(out, placed.cameras, up)
    warn([*placed.remarks, *remarks_on(placed.cameras)])
    table = table_of("camera", "points", "error, mm", "worst", "height, m")
    for camera in placed.cameras:
        off_mm = placed.errors_mm[np.array(points.cameras) == camera.name]
        figures = (f"{off_mm.mean():.1f}", f"{off_mm.max():.1f}", f"{camera.centre_world_m[2]:.2f}")
        table.add_row(escape(camera.name), f"{len(off_mm)}", *figures)
    stdout.print(table)
    say(f"{out}")


def in_world_of(cameras: Sequence[Camera], points: ScenePoints) -> tuple[tuple[Camera, ...], list[str]]:
    """Calibrated cameras moved to the world of measured points, and remarks; prints how well these fit."""
    placed = moved_to_points(cameras, points)
    say(
        f"{len(placed.errors_mm)} measured points are {placed.errors_mm.mean():.1f} mm from where the "
        f"cameras see them (mean; worst {placed.errors_mm.max():.1f} mm); the cameras' lengths are "
        f"{placed.scale:.4f} times the measured ones"
    )
    remarks = list(placed.remarks)
    if abs(placed.scale - 1.0) > _SCALE_OFF:
        remarks.append(
            f"{points.path}: the cameras' lengths are {placed.scale:.3f} times those of the measured points: "
            f"measure the board again, or give --scale {1.0 / placed.scale:.4g} with --import"
        )
    return placed.cameras, remarks
