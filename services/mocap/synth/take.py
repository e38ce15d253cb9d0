"""Writes a synthetic take: videos, clean plates, calibration, and everything that is known about them.

One seed makes one take: each frame of each camera has its own random numbers, whatever the order of drawing.
"""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.synth.backdrop import RoomView, view_room
from services.mocap.synth.motion import STAND_S, walk
from services.mocap.synth.render import Model, expose, render
from services.mocap.synth.room import room_patches
from services.mocap.synth.studio import studio_cameras
from services.mocap.take import layout
from services.mocap.take.settings import TakeSettings
from services.mocap.take.tables import PoseTable, reference_joints, write_poses_csv
from services.mocap.take.writer import TakeWriter, take_writer, write_picture
from services.mocap.types import Floats

HEIGHTS_M = (1.0, 1.9)
"""Smallest and largest actor that the studio's pictures hold with raised arms."""
BACKGROUND_FRAMES = 30

Views = list[tuple[Camera, RoomView]]


def write_synthetic_take(
    folder: Path,
    *,
    n_frames: int = 60,
    fps: float = 15,
    seed: int = 0,
    height_m: float = 1.75,
    n_cameras: int = 8,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a take of an actor of a height who walks, raises the arms and turns, seen by a ring of cameras.

    Beside the files of every take it holds reference/joints.csv, reference/poses.csv and the exact
    silhouettes, reference/silhouettes/<camera>/000000.png and so on. progress is called after each frame with
    the number of frames done and of all frames. Raises UserError when the folder is there already or a number
    is out of range; then nothing is left behind.
    """
    _check(n_frames, fps, seed, height_m, n_cameras)
    body = build_body(Actor(height=height_m))
    poses = walk(n_frames, fps, body)
    settings = TakeSettings(
        name=folder.resolve().name,
        fps=float(fps),
        units="m",
        up="z",
        frames=n_frames,
        actor_height=height_m,
        init_frames=min(n_frames, max(1, int(STAND_S * fps))),
    )
    cameras = studio_cameras(n_cameras)
    with take_writer(folder, settings, cameras) as writer:
        _write_poses(writer, poses, body, fps)
        patches = room_patches(seed)
        views = [(camera, view_room(camera, patches, seed)) for camera in cameras]
        _write_backgrounds(writer, views, seed)
        _write_videos(writer, views, Model(body), poses, seed, progress)


def _check(n_frames: int, fps: float, seed: int, height_m: float, n_cameras: int) -> None:
    """Raise UserError with one sentence for the first number that is out of range."""
    low_m, high_m = HEIGHTS_M
    for name, value, fits, expected in (
        ("frames", n_frames, n_frames >= 1, "1 or more"),
        ("fps", fps, 1 <= fps <= 240, "1 to 240 frames per second"),
        ("seed", seed, seed >= 0, "0 or more"),
        (
            "height",
            height_m,
            low_m <= height_m <= high_m,
            f"{low_m} to {high_m} m, what the studio's pictures hold",
        ),
        ("cameras", n_cameras, 1 <= n_cameras <= 64, "1 to 64"),
    ):
        if not fits:
            raise UserError(f"synth: {name} = {value}: expected {expected}")


def _write_poses(writer: TakeWriter, poses: Floats, body: Body, fps: float) -> None:
    """The truth: joints.csv, and poses.csv, whose energy against the exact silhouettes is zero."""
    writer.reference_joints(reference_joints(poses, body.offsets_m))
    frames = np.arange(len(poses), dtype=np.int32)
    table = PoseTable(frames, frames / fps, poses, energies_px=np.zeros(len(poses)))
    write_poses_csv(writer.folder / "reference/poses.csv", table)


def _write_backgrounds(writer: TakeWriter, views: Views, seed: int) -> None:
    for c, (camera, view) in enumerate(views):
        with writer.background_video(camera) as video:
            for frame in range(BACKGROUND_FRAMES):
                video.write(expose(view.picture, np.random.default_rng((seed, 3, c, frame))))


def _write_videos(
    writer: TakeWriter,
    views: Views,
    model: Model,
    poses: Floats,
    seed: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """All videos and silhouettes, frame by frame, since a posed and lit figure serves all cameras."""
    with ExitStack() as open_videos:
        videos = [open_videos.enter_context(writer.video(camera)) for camera, _ in views]
        for frame, pose in enumerate(poses):
            figure = model.pose(pose)
            for c, (camera, view) in enumerate(views):
                picture, silhouette = render(camera, view, figure)
                videos[c].write(expose(picture, np.random.default_rng((seed, 4, c, frame))))
                masks = layout.silhouette_folder(writer.folder / "reference", camera.name)
                write_picture(layout.silhouette_path(masks, frame), silhouette)
            if progress is not None:
                progress(frame + 1, len(poses))
