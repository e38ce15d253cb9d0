"""joints.csv and poses.csv: tables of results, and of references to compare them with.

Points and cameras of a take's files (calibration.toml, joints.csv) are in the take's own world, y-up or z-up.
Pose parameters (poses.csv, `[initial_pose]` in take.toml) always mean the z-up world used inside, since the
skeleton's table defines them there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import DOFS, JOINT_INDEX
from services.mocap.camera.calibration import Up
from services.mocap.camera.camera import R_ZUP_YUP
from services.mocap.errors import TakeError
from services.mocap.take.csv_columns import Columns, as_cells, frame_cells, read_columns, write_columns
from services.mocap.take.marks import MARK_COLUMNS, Marks, mark_cells, read_marks
from services.mocap.take.quantities import QUANTITIES, Solved, further_columns, marks_of
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
_PUBLISHED_COLUMNS = [dof.column for dof in DOFS if dof.in_paper]
_ROWS = [row for row in QUANTITIES if row.file == "poses.csv"]
_DIGITS = {row.column.format(label): row.digits for row in _ROWS for label in row.labels}
_LARGEST_FRAME = 2**31 - 1


def to_take_world(points_world_m: Floats, up: Up) -> Floats:
    """(…, 3) points of the internal z-up world, in the take's world."""
    return points_world_m if up == "z" else points_world_m @ R_ZUP_YUP


def from_take_world(points_take_m: Floats, up: Up) -> Floats:
    """(…, 3) points of the take's world, in the internal z-up world."""
    return points_take_m if up == "z" else points_take_m @ R_ZUP_YUP.T


def reference_joints(poses: Floats, offsets_m: Floats) -> Floats:
    """The joints of joints.csv (N, 15, 3) in the internal z-up world, of poses (N, D).

    offsets_m: (J, 3), as joint_positions takes them.
    """
    return joint_positions(poses, offsets_m)[:, [JOINT_INDEX[name] for name in REFERENCE_JOINTS]]


@dataclass(frozen=True, eq=False)
class JointTable:
    """The content of joints.csv."""

    frames: Ints
    """(N,) frame numbers, increasing."""
    times_s: Floats
    """(N,)"""
    joints_take_m: Floats
    """(N, 15, 3) in the world of the take's files."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """The content of poses.csv."""

    frames: Ints
    """(N,) frame numbers, increasing."""
    times_s: Floats
    """(N,)"""
    poses: Floats
    """(N, D) in metres and radians."""
    energies_px: Floats
    """(N,) differing pixels, summed over the cameras."""
    extra: Mapping[str, Floats] = field(default_factory=dict)
    """Further columns (N,) by name."""
    marks: Marks | None = None
    """The marks of the N frames; None if they were not judged, as in references."""

    @classmethod
    def of(cls, frames: Ints, times_s: Floats, solved: Sequence[Solved], *, is_live: bool) -> "PoseTable":
        """The table of N solved frames, with all that is known of them."""
        return cls(
            frames,
            times_s,
            np.array([frame.pose for frame in solved]),
            np.array([frame.energy_px for frame in solved]),
            further_columns(solved, is_live=is_live),
            marks_of(solved),
        )

    def by_frame(self) -> dict[int, Floats]:
        """The poses (D,) by frame."""
        return dict(zip(self.frames.tolist(), self.poses, strict=True))

    @property
    def frames_shown(self) -> Ints:
        """(N,) the frame of the take that shows each pose: of live poses the shot, as recordings count."""
        return np.asarray(self.extra.get("shot", self.frames), np.int32)


def write_joints_csv(path: Path, frames: Ints, times_s: Floats, joints_take_m: Floats) -> None:
    """joints_take_m: (N, 15, 3) in the world of the take's files; written to 0.01 mm."""
    coordinates = np.reshape(joints_take_m, (len(frames), len(_JOINT_COLUMNS)))
    columns = {name: as_cells(name, x, ".5f") for name, x in zip(_JOINT_COLUMNS, coordinates.T, strict=True)}
    write_columns(path, {**frame_cells(frames, "time", times_s), **columns})


def read_joints_csv(path: Path) -> JointTable:
    """Raises TakeError, which names the file and the column or line."""
    columns = read_columns(path, ["frame", "time", *_JOINT_COLUMNS], allow_extra=False)
    coordinates = np.column_stack([columns.numbers(name) for name in _JOINT_COLUMNS])
    return JointTable(
        frames=_frames(columns),
        times_s=columns.numbers("time"),
        joints_take_m=coordinates.reshape(-1, len(REFERENCE_JOINTS), 3),
    )


def write_poses_csv(path: Path, table: PoseTable) -> None:
    """Poses are written to a micrometre and a microradian; raises ValueError for invalid names of extra
    columns."""
    known = {"frame", "time_s", "energy_px", *_POSE_COLUMNS, *MARK_COLUMNS}
    if clash := known & table.extra.keys():
        raise ValueError(f"extra: {', '.join(sorted(clash))}: are columns of poses.csv already")
    columns = frame_cells(table.frames, "time_s", table.times_s)
    columns |= {
        name: as_cells(name, values, ".6f") for name, values in zip(_POSE_COLUMNS, table.poses.T, strict=True)
    }
    columns["energy_px"] = as_cells("energy_px", table.energies_px, _DIGITS["energy_px"])
    columns |= {} if table.marks is None else mark_cells(table.marks)
    columns |= {name: as_cells(name, x, _DIGITS.get(name, ".10g")) for name, x in table.extra.items()}
    write_columns(path, columns)


def read_poses_csv(path: Path) -> PoseTable:
    """Raises TakeError, which names the file and the column or line; columns it does not know are `extra`.

    Parameters that the published body lacks are zero in files without them, as older ones are.
    """
    required = ["frame", "time_s", *_PUBLISHED_COLUMNS, "energy_px"]
    columns = read_columns(path, required, allow_extra=True)
    known = {*required, *_POSE_COLUMNS, *MARK_COLUMNS}
    zeros = np.zeros(len(columns.lines))
    return PoseTable(
        frames=_frames(columns),
        times_s=columns.numbers("time_s"),
        poses=np.column_stack(
            [columns.numbers(name) if name in columns.cells else zeros for name in _POSE_COLUMNS]
        ),
        energies_px=columns.numbers("energy_px"),
        extra={name: columns.numbers(name) for name in columns.cells if name not in known},
        marks=read_marks(columns),
    )


def _frames(columns: Columns) -> Ints:
    numbers = columns.numbers("frame")
    whole = (numbers == np.floor(numbers)) & (numbers >= 0) & (numbers <= _LARGEST_FRAME)
    if not np.all(whole) or np.any(np.diff(numbers) <= 0):
        raise TakeError(
            f"{columns.path}: frame: expected whole numbers from 0 up, each larger than the one before"
        )
    return numbers.astype(np.int32)
