"""joints.csv and poses.csv: results, and references to compare them with, as tables.

Points are in the world of the take's files (services.mocap.take.world turns them), pose parameters as the
skeleton's table defines them.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from services.mocap.atomic import atomic_file
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import DOFS, JOINT_INDEX
from services.mocap.errors import TakeError, in_short, nearest
from services.mocap.types import Floats, Ints

REFERENCE_JOINTS: tuple[str, ...] = (
    "pelvis",
    "neck",
    "head_top",
    *(
        f"{side}_{joint}"
        for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
        for side in ("left", "right")
    ),
)
"""The joints of joints.csv in the order of its columns; pelvis is the midpoint of the hip centres."""

_JOINT_COLUMNS = [f"{joint}_{axis}" for joint in REFERENCE_JOINTS for axis in "xyz"]
_POSE_COLUMNS = [dof.column for dof in DOFS]
_LARGEST_FRAME = 2**31 - 1


def reference_joints(poses: Floats, offsets_m: Floats) -> Floats:
    """The joints of joints.csv (N, 15, 3) in the inside z-up world, of poses (N, 35).

    offsets_m: (17, 3), as joint_positions takes them.
    """
    return joint_positions(poses, offsets_m)[:, [JOINT_INDEX[name] for name in REFERENCE_JOINTS]]


@dataclass(frozen=True, eq=False)
class JointTable:
    """What joints.csv holds."""

    frames: Ints
    """(N,) frame numbers, increasing."""
    times_s: Floats
    """(N,)"""
    joints_take_m: Floats
    """(N, 15, 3) in the world of the take's files."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """What poses.csv holds."""

    frames: Ints
    """(N,) frame numbers, increasing."""
    times_s: Floats
    """(N,)"""
    poses: Floats
    """(N, 35) in metres and radians."""
    energies_px: Floats
    """(N,) differing pixels, summed over the cameras."""
    extra: Mapping[str, Floats] = field(default_factory=dict)
    """Further columns (N,) by name."""


def write_joints_csv(path: Path, frames: Ints, times_s: Floats, joints_take_m: Floats) -> None:
    """joints_take_m: (N, 15, 3) in the world of the take's files; written to 0.01 mm."""
    coordinates = np.reshape(joints_take_m, (len(frames), len(_JOINT_COLUMNS)))
    columns = dict(zip(_JOINT_COLUMNS, coordinates.T, strict=True))
    _write(path, frames, "time", times_s, {name: (values, ".5f") for name, values in columns.items()})


def read_joints_csv(path: Path) -> JointTable:
    """Raises TakeError, which names the file and the column or line."""
    columns = _read(path, ["frame", "time", *_JOINT_COLUMNS], allow_extra=False)
    coordinates = np.column_stack([columns[name] for name in _JOINT_COLUMNS])
    return JointTable(
        frames=_frames(path, columns["frame"]),
        times_s=columns["time"],
        joints_take_m=coordinates.reshape(-1, len(REFERENCE_JOINTS), 3),
    )


def write_poses_csv(path: Path, table: PoseTable) -> None:
    """Poses are written to a micrometre and a microradian; raises ValueError for extra columns' odd names."""
    known = {"frame", "time_s", "energy_px", *_POSE_COLUMNS}
    if clash := known & table.extra.keys():
        raise ValueError(f"extra: {', '.join(sorted(clash))}: are columns of poses.csv already")
    columns = {name: (values, ".6f") for name, values in zip(_POSE_COLUMNS, table.poses.T, strict=True)}
    columns["energy_px"] = (table.energies_px, ".10g")
    columns |= {name: (values, ".10g") for name, values in table.extra.items()}
    _write(path, table.frames, "time_s", table.times_s, columns)


def read_poses_csv(path: Path) -> PoseTable:
    """Raises TakeError, which names the file and the column or line; columns it does not know are `extra`."""
    required = ["frame", "time_s", *_POSE_COLUMNS, "energy_px"]
    columns = _read(path, required, allow_extra=True)
    return PoseTable(
        frames=_frames(path, columns["frame"]),
        times_s=columns["time_s"],
        poses=np.column_stack([columns[name] for name in _POSE_COLUMNS]),
        energies_px=columns["energy_px"],
        extra={name: values for name, values in columns.items() if name not in required},
    )


def _write(
    path: Path, frames: Ints, time_column: str, times_s: Floats, columns: Mapping[str, tuple[Floats, str]]
) -> None:
    """columns: (N,) values and their format by name."""
    for name, (values, _) in columns.items():
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{name}: expected finite numbers")
    with atomic_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["frame", time_column, *columns])
        for i, frame in enumerate(frames):
            cells = (format(values[i], digits) for values, digits in columns.values())
            writer.writerow([int(frame), f"{times_s[i]:.6f}", *cells])


def _read(path: Path, required: Sequence[str], *, allow_extra: bool) -> dict[str, Floats]:
    """All columns (N,) by name."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            header = next(rows, [])
            _check_header(path, header, required, allow_extra=allow_extra)
            values = [_numbers(path, rows.line_num, header, cells) for cells in rows if cells]
    except FileNotFoundError:
        raise TakeError(f"{path}: is missing: expected a table of comma-separated values") from None
    except (OSError, UnicodeDecodeError, csv.Error):
        raise TakeError(f"{path}: cannot be read: expected a table of comma-separated values") from None
    if not values:
        raise TakeError(f"{path}: holds no rows: expected one for every frame")
    return dict(zip(header, np.array(values).T.copy(), strict=True))


def _check_header(path: Path, header: list[str], required: Sequence[str], *, allow_extra: bool) -> None:
    unknown = [name for name in header if name not in required]
    missing = [name for name in required if name not in header]
    if unknown and not allow_extra:
        raise TakeError(
            f"{path}: {in_short(unknown[0])}: unknown column: {nearest(unknown[0], missing or required)}"
        )
    if missing:
        raise TakeError(
            f"{path}: {missing[0]}: column is missing: expected {len(required)} columns "
            f"from {required[0]} to {required[-1]}"
        )
    if len(set(header)) < len(header):
        twice = next(name for name in header if header.count(name) > 1)
        raise TakeError(f"{path}: {in_short(twice)}: column is there twice: expected every column once")


def _numbers(path: Path, line: int, header: list[str], cells: list[str]) -> list[float]:
    if len(cells) != len(header):
        raise TakeError(
            f"{path}: line {line}: expected {len(header)} values as in the header, found {len(cells)}"
        )
    row: list[float] = []
    for name, cell in zip(header, cells, strict=True):
        try:
            row.append(float(cell))
        except ValueError:
            row.append(np.nan)
        if not np.isfinite(row[-1]):
            raise TakeError(f"{path}: line {line}: {name}: expected a finite number, found {in_short(cell)}")
    return row


def _frames(path: Path, numbers: Floats) -> Ints:
    whole = (numbers == np.floor(numbers)) & (numbers >= 0) & (numbers <= _LARGEST_FRAME)
    if not np.all(whole) or np.any(np.diff(numbers) <= 0):
        raise TakeError(f"{path}: frame: expected whole numbers from 0 up, each larger than the one before")
    return numbers.astype(np.int32)
