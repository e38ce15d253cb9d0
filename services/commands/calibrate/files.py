"""Converting calibrations of other tools, for the command."""

import re
from pathlib import Path
from typing import Literal

from rich.console import Console

from services.commands.consoles import warn
from services.mocap.calibration.remarks import remarks_on
from services.mocap.camera.calibration import Up
from services.mocap.camera.formats import Axis, Format, Units, read_any, write_opencv, write_pose2sim
from services.mocap.errors import UserError

_SIZE = re.compile(r"(\d{1,5})[xX](\d{1,5})")


def convert(
    source: Path,
    kind: Format | None,
    out: Path,
    target: Literal["pose2sim", "opencv"],
    size: str | None,
    units: Units,
    scale: float,
    its_up: Axis,
    up: Up,
    errors: Console,
) -> None:
    """Read a calibration of any known format and write it in another (see read_any); warn of what is odd."""
    match = None if size is None else _SIZE.fullmatch(size)
    if size is not None and match is None:
        raise UserError(f"--size {size}: expected width and height in pixels, such as 1920x1080")
    if not source.exists():
        raise UserError(f"{source}: is missing: expected a calibration to import")
    size_px = None if match is None else (int(match[1]), int(match[2]))
    cameras, remarks = read_any(source, kind, size_px, units, scale, its_up)
    write = write_pose2sim if target == "pose2sim" else write_opencv
    write(out, cameras, up)
    warn((*remarks, *remarks_on(cameras)), errors)
