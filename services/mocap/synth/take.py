"""Writes a synthetic take: videos, clean plates, calibration, and everything that is known about them.

One seed makes one take: each frame of each camera has its own random numbers, whatever the order of drawing.
"""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.synth.motions import Performance, make_motion
from services.mocap.synth.render import Model, expose, render
from services.mocap.synth.room import RoomView, room_patches, view_room
from services.mocap.synth.studio import STAGE_HEIGHT_M, STAGE_RADIUS_M, studio_cameras
from services.mocap.synth.walk import STAND_S
from services.mocap.take import layout
from services.mocap.take.settings import TakeSettings
from services.mocap.take.tables import PoseTable, reference_joints, write_joints_csv, write_poses_csv
from services.mocap.take.writer import REPRODUCIBLE, take_writer, video_writer, write_picture
from services.mocap.types import Floats

HEIGHTS_M = (1.0, 1.9)
"""Smallest and largest actor that the studio's pictures hold with raised arms."""
LARGEST_STAGE_M = 4.0
"""Radius of the largest stage a studio is made for, in metres."""
BACKGROUND_FRAMES = 30
_HAND = 0.12  # body heights from the wrist to the fingertips, and from the ankle to the toes

Views = list[tuple[Camera, RoomView]]


def write_synthetic_take(
    folder: Path,
    *,
    motion: str = "walk",
    n_frames: int | None = None,
    start_s: float = 0.0,
    fps: float = 15,
    seed: int = 0,
    height_m: float = 1.75,
    n_cameras: int = 8,
    progress: Callable[[int, int], None] | None = None,
) -> Performance:
    """Write a take of an actor of a height in a motion (see make_motion), seen by a ring of cameras.

    Beside the files of every take it holds reference/joints.csv, reference/poses.csv and the exact
    silhouettes, reference/silhouettes/<camera>/000000.png and so on. progress is called after each frame with
    the number of frames done and of all frames. Returns what the actor does. Raises UserError when the folder
    is there already, a number is out of range, or the actor goes farther than a studio reaches; then nothing
    is left behind.
    """
    _check(n_frames, start_s, fps, seed, height_m, n_cameras)
    body = build_body(Actor(height=height_m))
    made = make_motion(motion, n_frames, fps, body, seed, start_s)
    n_frames, (radius_m, top_m) = len(made.poses), stage_size_m(made.poses, body)
    settings = TakeSettings(
        name=folder.resolve().name,
        fps=float(fps),
        units="m",
        up="z",
        frames=n_frames,
        actor_height=height_m,
        init_frames=min(n_frames, max(1, int(STAND_S * fps))),
    )
    cameras = studio_cameras(n_cameras, stage_radius_m=radius_m, stage_height_m=top_m)
    with take_writer(folder, settings, cameras) as part:
        frames = np.arange(n_frames, dtype=np.int32)
        joints_m = reference_joints(made.poses, body.offsets_m)
        write_joints_csv(part / layout.REFERENCE_JOINTS_CSV, frames, frames / fps, joints_m)
        truth = PoseTable(frames, frames / fps, made.poses, energies_px=np.zeros(n_frames))
        write_poses_csv(part / "reference/poses.csv", truth)
        patches = room_patches(seed, radius_m / STAGE_RADIUS_M)
        views = [(camera, view_room(camera, patches, seed)) for camera in cameras]
        _write_videos(part, fps, views, Model(body), made.poses, seed, progress)
    return made


def _check(
    n_frames: int | None, start_s: float, fps: float, seed: int, height_m: float, n_cameras: int
) -> None:
    """Raise UserError with one sentence for the first number that is out of range."""
    low_m, high_m = HEIGHTS_M
    held = f"{low_m} to {high_m} m, what the studio's pictures hold"
    for name, value, fits, expected in (
        ("frames", n_frames, n_frames is None or n_frames >= 1, "1 or more"),
        ("start", start_s, start_s >= 0, "0 seconds or more"),
        ("fps", fps, 1 <= fps <= 240, "1 to 240 frames per second"),
        ("seed", seed, seed >= 0, "0 or more"),
        ("height", height_m, low_m <= height_m <= high_m, held),
        ("cameras", n_cameras, 1 <= n_cameras <= 64, "1 to 64"),
    ):
        if not fits:
            raise UserError(f"synth: {name} = {value}: expected {expected}")


def stage_size_m(poses: Floats, body: Body) -> tuple[float, float]:
    """Radius and height of a stage that the actor in these poses (N, D), hands and feet, does not leave.

    Raises UserError where no studio has one.
    """
    joints_world_m = joint_positions(poses, body.offsets_m)
    away_m = np.hypot(joints_world_m[..., 0], joints_world_m[..., 1])
    radius_m, top_m = (
        float(most_m) + _HAND * body.height_m for most_m in (away_m.max(), joints_world_m[..., 2].max())
    )
    if radius_m > LARGEST_STAGE_M:
        raise UserError(
            f"synth: the motion leads {radius_m:.1f} m away from its middle: expected at most"
            f" {LARGEST_STAGE_M} m, what a studio holds: take a part of it, with --start and --frames"
        )
    return max(STAGE_RADIUS_M, radius_m), max(STAGE_HEIGHT_M, top_m)


def _write_videos(
    folder: Path,
    fps: float,
    views: Views,
    model: Model,
    poses: Floats,
    seed: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """All clean plates, then all videos and silhouettes, frame by frame, since a posed and lit figure serves
    all cameras."""
    for c, (camera, view) in enumerate(views):
        plate_path = layout.background_video_path(folder, camera.name)
        with video_writer(plate_path, *camera.size_px, fps, options=REPRODUCIBLE) as video:
            for frame in range(BACKGROUND_FRAMES):
                video.write(expose(view.picture, np.random.default_rng((seed, 3, c, frame))))
    with ExitStack() as open_videos:
        videos = []
        for camera, _ in views:
            path = layout.video_path(folder, camera.name)
            writer = video_writer(path, *camera.size_px, fps, options=REPRODUCIBLE)
            videos.append(open_videos.enter_context(writer))
        for frame, pose in enumerate(poses):
            figure = model.pose(pose)
            for c, (camera, view) in enumerate(views):
                picture, silhouette = render(camera, view, figure)
                videos[c].write(expose(picture, np.random.default_rng((seed, 4, c, frame))))
                masks = layout.silhouette_folder(folder / "reference", camera.name)
                write_picture(layout.silhouette_path(masks, frame), silhouette)
            if progress is not None:
                progress(frame + 1, len(poses))
