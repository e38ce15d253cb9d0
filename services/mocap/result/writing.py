"""The files of a result from which all others can be made."""

from dataclasses import replace
from pathlib import Path

from services.mocap.body.actor import MESH_FILE, Actor, build_body
from services.mocap.camera.calibration import Up
from services.mocap.result.layout import JOINTS, POSES, POSES_SMOOTH
from services.mocap.take.layout import ACTOR
from services.mocap.take.tables import PoseTable, reference_joints, write_joints_csv, write_poses_csv
from services.mocap.take.world import to_take_world
from services.mocap.types import Floats


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
