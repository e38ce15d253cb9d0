"""The files of a result from which all others can be made; poses.csv and actor.toml are enough to read it."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from services.mocap.atomic import write_file
from services.mocap.body.actor import MESH_FILE, Actor, build_body
from services.mocap.camera.calibration import Up
from services.mocap.errors import TakeError, UserError
from services.mocap.motion.angles import joint_angles_deg
from services.mocap.motion.motion import Motion
from services.mocap.result.frame_files import FRAME_FILES, read_frame_file
from services.mocap.result.layout import JOINTS, POSES, POSES_SMOOTH, RUN_JSON
from services.mocap.take.actor_file import read_actor
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import ACTOR, SETTINGS
from services.mocap.take.marks import DISTRUSTED, PARTS
from services.mocap.take.moved_cameras import take_as_in
from services.mocap.take.quantities import FURTHER, Labelled
from services.mocap.take.segmenter_name import AUTO
from services.mocap.take.tables import (
    PoseTable,
    read_poses_csv,
    reference_joints,
    to_take_world,
    write_joints_csv,
    write_poses_csv,
)
from services.mocap.types import Floats, Ints, Mask

_FPS_OF_ONE_FRAME = 30.0
"""The rate written for a single frame, which has none."""


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a run: one pose for each of N consecutive frames. World: z-up, metres."""

    folder: Path
    actor: Actor
    motion: Motion
    """The motion as written to files: smoothed if the run smoothed."""
    tracked: PoseTable
    """The same frames as they were tracked, with energy and marks."""
    run: dict[str, Any]
    """run.json; empty if there is none."""

    @property
    def frames(self) -> Ints:
        """(N,) numbers of the frames in the take."""
        return self.motion.frames

    @property
    def times_s(self) -> Floats:
        """(N,) times in the take, in seconds."""
        return self.motion.times_s

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.motion.fps

    @property
    def poses(self) -> Floats:
        """(N, D) pose parameters in metres and radians, in the order of DOF_NAMES."""
        return self.motion.poses

    @property
    def take_folder(self) -> Path | None:
        """The take that was tracked, if run.json names it."""
        folder = self.run.get("take", {}).get("folder")
        return Path(folder) if isinstance(folder, str) else None

    @property
    def segmenter(self) -> str:
        """What made the silhouettes, as --segmenter names it, if run.json tells."""
        return str(self.run.get("settings", {}).get("segmenter", AUTO))

    @cached_property
    def joints_world_m(self) -> Floats:
        """(N, 15, 3) joint centres in the z-up world, in the order of REFERENCE_JOINTS."""
        return reference_joints(self.poses, self.motion.body.offsets_m)

    @cached_property
    def angles_deg(self) -> dict[str, Floats]:
        """Anatomical joint angles (N,) in degrees by name, as angles.csv has them."""
        return joint_angles_deg(self.motion.T_world_joint)

    @cached_property
    def quantities(self) -> dict[str, Labelled]:
        """What poses.csv, energies.csv and timings.csv know of the N frames, by a quantity's name and label.

        Files that are of other frames do not count. Raises TakeError for those that cannot be read.
        """
        known: dict[str, Labelled] = {
            "energy_px": {"": self.energies_px},
            "confidence": dict(zip(PARTS, self.confidence.T, strict=True)),
            DISTRUSTED: dict(zip(PARTS, self.distrusted.T, strict=True)),
        }
        for row in FURTHER:  # as far as poses.csv has it
            columns = {label: self.tracked.extra.get(row.column.format(label)) for label in row.labels}
            known[row.name] = {label: column for label, column in columns.items() if column is not None}
        for path in (self.folder / name for name in FRAME_FILES):
            frames, values = read_frame_file(path) if path.exists() else (None, {})
            if frames is not None and np.array_equal(frames, self.frames):
                known |= values
        return known

    @property
    def energies_px(self) -> Floats:
        """(N,) pixels in which model and silhouettes differ, over all cameras, as tracked."""
        return self.tracked.energies_px

    @property
    def distrusted(self) -> Mask:
        """(N, 6) unreliable parts, in the order of PARTS; none if they were not judged."""
        none: Mask = np.zeros((len(self.frames), len(PARTS)), bool)
        return none if self.tracked.marks is None else self.tracked.marks.distrusted

    @property
    def confidence(self) -> Floats:
        """(N, 6) confidence of each part, from 0 to 1; NaN if it was not judged."""
        none = np.full((len(self.frames), len(PARTS)), np.nan)
        return none if self.tracked.marks is None else self.tracked.marks.confidence


def write_tracked(
    folder: Path, tracked: PoseTable, actor: Actor, up: Up, smooth: Floats | None = None
) -> Floats:
    """Write poses.csv, joints.csv and actor.toml, and its mesh if it has one.

    up: the axis of the take's world. smooth: (N, D) poses after smoothing, where that was asked for; then
    joints.csv is of these, and poses_smooth.csv has them. Returns the joints (N, 15, 3) of joints.csv, in the
    z-up world.
    """
    write_poses_csv(folder / POSES, tracked)
    shown = tracked if smooth is None else replace(tracked, poses=smooth)
    if smooth is not None:
        write_poses_csv(folder / POSES_SMOOTH, shown)
    joints_world_m = reference_joints(shown.poses, build_body(actor).offsets_m)
    write_joints_csv(folder / JOINTS, tracked.frames, tracked.times_s, to_take_world(joints_world_m, up))
    (folder / ACTOR).write_text(actor.to_toml())
    if actor.mesh is not None:
        (folder / MESH_FILE).write_bytes(actor.mesh.content)
    return joints_world_m


def load_result(folder: Path | str) -> Result:
    """Read a results folder; raises UserError if it cannot be used."""
    folder = Path(folder)
    if not folder.is_dir():
        raise UserError(f"{folder}: is not a folder: expected a results folder of xormocap track")
    if (folder / SETTINGS).exists() and not (folder / POSES).exists():
        raise UserError(f"{folder}: is a take without results: type xormocap track {folder} first")
    if not (folder / POSES).exists():
        raise UserError(f"{folder}: has no {POSES}: expected a results folder, as xormocap track writes it")
    tracked = read_poses_csv(folder / POSES)
    _check_frames(folder / POSES, tracked)
    shown = tracked
    if (folder / POSES_SMOOTH).exists():
        shown = read_poses_csv(folder / POSES_SMOOTH)
        if not np.array_equal(shown.frames, tracked.frames):
            raise TakeError(f"{folder / POSES_SMOOTH}: frame: expected the frames of {POSES}")
    actor, run = read_actor(folder / ACTOR), _read_run(folder / RUN_JSON)
    motion = Motion(
        name=run.get("take", {}).get("name", folder.resolve().name),
        fps=_fps(tracked, run),
        frames=tracked.frames,
        times_s=tracked.times_s,
        poses=shown.poses,
        body=build_body(actor),
    )
    return Result(folder, actor, motion, tracked, run)


def check_take(result: Result, take: Take, where: str) -> None:
    """Raise UserError, whose sentence begins with where, if a result is of another take by its run.json."""
    name = result.run.get("take", {}).get("name", take.settings.name)
    if name != take.settings.name:
        raise UserError(
            f"{where}: is of {name!r}, not of {take.settings.name!r} in {take.folder}: expected the take "
            "that was tracked"
        )


def open_take_of(result: Result, folder: Path) -> Take:
    """Open the take of a result, or the recording of a live one.

    Raises UserError if it is another take, or as open_take.
    """
    take = open_take(folder)
    if "live" not in result.run:  # a recording is named like its folder
        check_take(result, take, str(result.folder))
    return take_as_in(result.folder, take)


@contextmanager
def edited_run(folder: Path) -> Iterator[dict[str, Any]]:
    """The run.json of a results folder, which is written again with the changes of this block."""
    path = folder / RUN_JSON
    run = _read_run(path)
    yield run
    write_file(path, json.dumps(run, indent=2) + "\n")


def _check_frames(path: Path, table: PoseTable) -> None:
    if np.any(np.diff(table.frames) != 1):
        after = int(table.frames[np.flatnonzero(np.diff(table.frames) != 1)[0]])
        raise TakeError(f"{path}: frame: expected every frame, found none after frame {after}")
    if np.any(np.diff(table.times_s) <= 0):
        raise TakeError(f"{path}: time_s: expected every time to be later than the one before")


def _read_run(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        run = None
    if not isinstance(run, dict) or not isinstance(run.get("take", {}), dict):
        raise TakeError(f"{path}: is not a file of xormocap track: restore it or remove it")
    return run


def _fps(table: PoseTable, run: dict[str, Any]) -> float:
    """The rate in run.json, else that of the table's times."""
    reported = run.get("take", {}).get("fps")
    if isinstance(reported, int | float) and reported > 0:
        return float(reported)
    if len(table.frames) == 1:
        return _FPS_OF_ONE_FRAME
    return float((len(table.frames) - 1) / (table.times_s[-1] - table.times_s[0]))
