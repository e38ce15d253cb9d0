"""`xormocap calibrate --import FILE`: converts calibrations of other tools."""

import math
import re
from pathlib import Path
from typing import Literal, TypeAlias

from services.commands.calibrate.points import in_world_of
from services.commands.consoles import say, warn
from services.mocap.calibration.placing import read_points
from services.mocap.calibration.remarks import remarks_on
from services.mocap.camera.calibration import Up, write_opencv, write_pose2sim
from services.mocap.camera.formats import Axis, Format, Units, UnknownFormatError, read_any
from services.mocap.errors import UserError

_SIZE = re.compile(r"([1-9]\d{0,4})[xX]([1-9]\d{0,4})")
Target: TypeAlias = Literal["pose2sim", "opencv"]


def import_calibration(
    source: Path,
    *,
    kind: Format | None,
    size: str | None,
    units: Units,
    scale: float,
    its_up: Axis | None,
    points: Path | None,
    out: Path | None,
    target: Target,
    up: Up,
) -> None:
    """Read cameras from any tool's file, and write them; raises UserError.

    points: measured points of the scene, whose world is taken.
    """
    if out is None:
        raise UserError("calibrate --import: expected --out, the file or folder to write")
    if out.exists() and source.exists() and out.samefile(source):
        raise UserError(f"--out {out}: is the file that is read: choose another one")
    if not (math.isfinite(scale) and scale > 0):
        raise UserError(f"--scale {scale:g}: expected a number above 0")
    match = None if size is None else _SIZE.fullmatch(size)
    if size is not None and match is None:
        raise UserError(f"--size {size}: expected width and height in pixels, such as 1920x1080")
    size_px = None if match is None else (int(match[1]), int(match[2]))
    try:
        cameras, remarks = read_any(source, kind, size_px, units, scale, its_up)
    except UnknownFormatError as problem:
        raise UserError(f"{problem}; or give its format with --from") from None
    if points is not None:
        measured = read_points(points, [camera.name for camera in cameras])
        cameras, more = in_world_of(cameras, measured)
        remarks += more
    write = write_pose2sim if target == "pose2sim" else write_opencv
    write(out, cameras, up)
    warn((*remarks, *remarks_on(cameras)))
    say(f"{out}")
