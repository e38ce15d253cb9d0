"""Reads motion from a BVH file of whatever tool: any hierarchy, any channels in any order.

The PyPI readers (bvh, bvhio, bvhsdk) stop at broken files with a bare traceback and compose the joints frame
by frame; the format is small enough to be read here, with one clear sentence for what is wrong.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from services.mocap.errors import UserError, in_short
from services.mocap.types import Floats

_POSITIONS = ("xposition", "yposition", "zposition")
_ROTATIONS = ("xrotation", "yrotation", "zrotation")


@dataclass
class BvhJoint:
    """One joint of the hierarchy, or the tip of a last bone."""

    name: str
    parent: int
    """Index of its parent, -1 for the root."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """From its parent in the rest pose, in the file's unit and axes."""
    channels: list[str] = field(default_factory=list)
    """Lower case, in the order of the numbers; none for a tip."""


@dataclass(frozen=True, eq=False)
class BvhMotion:
    """A file's skeleton and how it moves, in the file's unit and axes."""

    joints: tuple[BvhJoint, ...]
    """Parents before children."""
    frame_s: float
    positions_local: Floats
    """(N, J, 3) each joint against its parent, in the parent's frame."""
    rotations_local: Floats
    """(N, J, 4) each joint against its parent, as quaternions x, y, z, w; in the rest pose all are 1."""

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last one."""
        return (len(self.positions_local) - 1) * self.frame_s

    def rest(self) -> Floats:
        """(J, 3) the joints' places in the rest pose, the root at the origin."""
        places = np.zeros((len(self.joints), 3))
        for j, joint in enumerate(self.joints):
            if joint.parent >= 0:
                places[j] = places[joint.parent] + joint.offset
        return places

    def sample(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Places (T, J, 3) and rotations (T, J, 3, 3) against the file's world at times within the motion."""
        at_s = np.clip(times_s, 0.0, self.duration_s)
        frames_s: Floats = np.arange(float(len(self.positions_local))) * self.frame_s
        places, R = np.empty((len(at_s), len(self.joints), 3)), np.empty((len(at_s), len(self.joints), 3, 3))
        for j, joint in enumerate(self.joints):
            local = np.stack([np.interp(at_s, frames_s, x) for x in self.positions_local[:, j].T], axis=1)
            turns = Rotation.from_quat(self.rotations_local[:, j])
            if len(frames_s) == 1:
                turn = np.repeat(turns.as_matrix(), len(at_s), axis=0)
            else:
                turn = Slerp(frames_s, turns)(np.minimum(at_s, frames_s[-1])).as_matrix()
            if joint.parent < 0:
                places[:, j], R[:, j] = local, turn
            else:
                places[:, j] = places[:, joint.parent] + np.einsum("tij,tj->ti", R[:, joint.parent], local)
                R[:, j] = R[:, joint.parent] @ turn
        return places, R


def read_bvh(path: Path) -> BvhMotion:
    """Read a BVH file; raises UserError with one sentence for what cannot be worked with."""
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as problem:
        raise UserError(f"{path}: cannot be read ({problem.strerror}): expected a BVH file") from None
    head, found, motion = text.partition("MOTION")
    if "HIERARCHY" not in head or not found:
        raise UserError(f"{path}: expected a BVH file, with the words HIERARCHY and MOTION")
    joints = _read_hierarchy(path, head)
    frame_s, numbers = _read_motion(path, motion, sum(len(joint.channels) for joint in joints))
    return BvhMotion(tuple(joints), frame_s, *_unpack(joints, numbers))


def _read_hierarchy(path: Path, text: str) -> list[BvhJoint]:
    """All joints and tips; raises UserError for a second ROOT, which is another actor's."""
    joints: list[BvhJoint] = []
    open_joints: list[int] = []
    lines = text.replace("{", "\n{\n").replace("}", "\n}\n").splitlines()
    for words in (line.split() for line in lines if line.strip()):
        keyword = words[0].upper()
        if keyword == "ROOT" and joints:
            raise UserError(f"{path}: has more than one ROOT: expected the motion of one actor")
        if keyword in ("ROOT", "JOINT", "END"):
            parent = open_joints[-1] if open_joints else -1
            name = " ".join(words[1:]) if keyword != "END" else f"{joints[parent].name} end"
            joints.append(BvhJoint(name, parent))
        elif keyword == "{":
            open_joints.append(len(joints) - 1)
        elif keyword == "}" and open_joints:
            open_joints.pop()
        elif keyword == "OFFSET" and joints:
            x, y, z = _numbers(path, words[1:4], 3, f"OFFSET of {joints[-1].name}")
            joints[-1].offset = (x, y, z)
        elif keyword == "CHANNELS" and joints:
            joints[-1].channels = [name.lower() for name in words[2:]]
            if unknown := [name for name in joints[-1].channels if name not in _POSITIONS + _ROTATIONS]:
                raise UserError(
                    f"{path}: CHANNELS of {joints[-1].name}: {in_short(unknown[0])}: expected Xposition, …, "
                    "Zrotation"
                )
    if not joints or open_joints:
        raise UserError(f"{path}: HIERARCHY: expected a ROOT with its joints, every {{ closed by a }}")
    return joints


def _numbers(path: Path, words: list[str], count: int, what: str) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise UserError(f"{path}: {what}: expected {count} numbers, found {in_short(' '.join(words))}")
    return numbers


def _read_motion(path: Path, text: str, n_channels: int) -> tuple[float, Floats]:
    """Seconds per frame, and the numbers (N, n_channels)."""
    _, found, rows = text.partition("Frame Time:")
    if not found or n_channels == 0:
        raise UserError(f"{path}: MOTION: expected Frames:, Frame Time: and a row of numbers for each frame")
    seconds, _, rows = rows.strip().partition("\n")
    frame_s = _numbers(path, seconds.split(), 1, "Frame Time")[0]
    if not 1e-4 <= frame_s <= 10.0:
        raise UserError(f"{path}: Frame Time: expected seconds from 0.0001 to 10, found {frame_s}")
    try:
        numbers = np.array(rows.split(), np.float64)
    except ValueError as problem:
        raise UserError(f"{path}: MOTION: expected numbers only: {problem}") from None
    if not np.isfinite(numbers).all():
        raise UserError(f"{path}: MOTION: expected finite numbers, found nan or inf")
    if len(numbers) == 0:
        raise UserError(f"{path}: MOTION: has no frames: expected a row of {n_channels} numbers for each")
    if len(numbers) % n_channels:
        raise UserError(
            f"{path}: MOTION: expected {n_channels} numbers for each frame, found {len(numbers)} in all"
        )
    return frame_s, numbers.reshape(-1, n_channels)


def _unpack(joints: list[BvhJoint], numbers: Floats) -> tuple[Floats, Floats]:
    """Positions (N, J, 3) and quaternions (N, J, 4) of all joints against their parents."""
    positions = np.tile(np.array([joint.offset for joint in joints]), (len(numbers), 1, 1))
    quaternions = np.tile([0.0, 0.0, 0.0, 1.0], (len(numbers), len(joints), 1))
    first = 0
    for j, joint in enumerate(joints):
        columns = dict(zip(joint.channels, numbers[:, first : first + len(joint.channels)].T, strict=True))
        first += len(joint.channels)
        moved = [name in columns for name in _POSITIONS]
        if any(moved):
            given = np.stack([columns.get(name, np.zeros(len(numbers))) for name in _POSITIONS], axis=1)
            positions[:, j] = _placed(given, np.array(moved), np.array(joint.offset), joint.parent < 0)
        order = "".join(name[0].upper() for name in joint.channels if name in _ROTATIONS)
        if order:
            angles_deg = np.stack([columns[name] for name in joint.channels if name in _ROTATIONS], axis=1)
            quaternions[:, j] = Rotation.from_euler(order, angles_deg, degrees=True).as_quat()
    return positions, quaternions


def _placed(given: Floats, moved: Floats, offset: Floats, is_root: bool) -> Floats:
    """Where position channels (N, 3) put a joint: most tools write all of the place, some add to OFFSET.

    For a joint below the root the reading counts that keeps its bone's length nearer to the rest pose's.
    """
    middle = np.median(given, axis=0)
    whole = is_root or np.linalg.norm((middle - offset)[moved]) <= np.linalg.norm(middle[moved])
    return np.where(moved, given if whole else given + offset, offset)
