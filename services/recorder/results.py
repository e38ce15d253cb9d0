"""A take's results as files: all of them, or none."""

import logging
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from proto.messages import Pose
from services.mocap.atomic import atomic_folder
from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.errors import UserError
from services.mocap.export.bvh import write_bvh
from services.mocap.take.actor_file import ACTOR
from services.mocap.take.folder import Take
from services.mocap.take.tables import REFERENCE_JOINTS, PoseTable, write_joints_csv, write_poses_csv
from services.mocap.take.world import to_take_world
from services.mocap.types import Floats, Ints
from services.recorder.collection import Collection
from services.recorder.overlay import write_overlay
from services.recorder.run_report import write_run_json

RUN_JSON = "run.json"

log = logging.getLogger(__name__)


def check_out(folder: Path) -> None:
    """Raise UserError unless results may go to a folder: a new or empty one, or one with older results."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file: expected a folder for the results")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / RUN_JSON).exists():
        raise UserError(
            f"{folder}: holds other files than results (no {RUN_JSON}): choose another folder for --out"
        )


def write_results(out: Path, take: Take, collection: Collection, overlay: bool) -> None:
    """Write poses.csv, joints.csv, motion.bvh, actor.toml, overlay.mp4 and run.json for what was recorded.

    Older results are replaced once the new ones are complete.
    """
    info = collection.info
    if info is None:
        raise UserError("no results: the coordinator said nothing about the take")
    recorded = collection.recorded()
    actor = Actor.from_toml(collection.blob(info.actor))
    body = build_body(actor)
    poses = np.array([message.pose for message in recorded])
    joints_world_m = reference_joints(poses, body)
    with _replacing(out) as part:
        frames: Ints = np.array([message.frame for message in recorded], np.int32)
        times_s = np.array([message.time_s for message in recorded])
        write_poses_csv(part / "poses.csv", PoseTable(frames, times_s, poses, _energies_px(recorded)))
        write_joints_csv(
            part / "joints.csv", frames, times_s, to_take_world(joints_world_m, take.settings.up)
        )
        write_bvh(part / "motion.bvh", poses, body.offsets_m, info.fps)
        (part / ACTOR).write_text(actor.to_toml())
        if overlay:
            log.info("drawing the overlay")
            write_overlay(part / "overlay.mp4", take, body, recorded)
        write_run_json(part / RUN_JSON, take, info, actor, recorded, joints_world_m)


def reference_joints(poses: Floats, body: Body) -> Floats:
    """The joints of joints.csv (N, 15, 3) in the inside world, of poses (N, 35)."""
    return joint_positions(poses, body.offsets_m)[:, [JOINT_INDEX[name] for name in REFERENCE_JOINTS]]


def _energies_px(recorded: list[Pose]) -> Floats:
    return np.array([message.energy_px for message in recorded])


@contextmanager
def _replacing(out: Path) -> Iterator[Path]:
    """Fill a new folder that takes the place of out, which may hold older results, if all goes well."""
    check_out(out)
    if not out.is_dir():
        with atomic_folder(out) as part:
            yield part
        return
    fresh = out.absolute().with_name(f".{out.absolute().name}.new")
    shutil.rmtree(fresh, ignore_errors=True)
    with atomic_folder(fresh) as part:
        yield part
    shutil.rmtree(out)
    fresh.replace(out)
