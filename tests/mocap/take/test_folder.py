import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
import pytest

from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.camera import Camera
from services.mocap.errors import TakeError
from services.mocap.take.folder import open_take
from services.mocap.take.layout import REFERENCE_JOINTS_CSV, silhouette_folder, silhouette_path, video_path
from services.mocap.take.settings import TakeSettings
from services.mocap.take.tables import read_joints_csv, to_take_world, write_joints_csv
from services.mocap.take.writer import take_writer, video_writer, write_picture
from services.mocap.types import ACTOR, Mask

SmallTake: TypeAlias = Callable[..., Path]
SmallCameras: TypeAlias = Callable[[int], list[Camera]]
BallSilhouette: TypeAlias = Callable[[Camera, int], Mask]
Refusal: TypeAlias = Callable[[Path], str]


@pytest.mark.parametrize(
    ("name", "source", "n_cameras", "size_px", "n_plates"),
    [
        ("studio-a", "videos", 8, (320, 240), 30),
        ("balance", "silhouettes", 4, (544, 960), 0),
        ("balance-static", "silhouettes", 4, (544, 960), 0),
    ],
)
def test_the_shared_takes_open(
    shared_takes: Path, name: str, source: str, n_cameras: int, size_px: tuple[int, int], n_plates: int
) -> None:
    take = open_take(shared_takes / name)
    camera, last = take.cameras[0], take.settings.frames - 1
    assert (take.settings.name, take.source, len(take.cameras)) == (name, source, n_cameras)
    assert camera.size_px == size_px
    with take.video(camera, last) as video:
        (picture,) = video
    assert picture.shape == (*size_px[::-1], 3)
    if n_plates:
        assert sum(plate.shape == picture.shape for plate in take.background(camera)) == n_plates
    else:
        (silhouette,) = take.trimaps(camera, last)
        assert silhouette.shape == picture.shape[:2]
        assert 0.02 < (silhouette == ACTOR).mean() < 0.5


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_written_take_is_read_again(
    tmp_path: Path, small_cameras: SmallCameras, ball_silhouette: BallSilhouette, up: str
) -> None:
    settings = TakeSettings.model_validate(
        {
            "name": "mine",
            "fps": 29.97,
            "units": "m",
            "up": up,
            "frames": 3,
            "actor_height": 1.8,
            "init_frames": 2,
            "facing": 90.0,
            "initial_pose": {"root_z_m": 0.9, "left_elbow_flexion_rad": 1},
        }
    )
    cameras = [replace(camera, name=f"{camera.name} é") for camera in small_cameras(2)]
    joints_world_m = np.random.default_rng(0).normal(size=(3, 15, 3)).round(5)
    with take_writer(tmp_path / "mine", settings, cameras) as part:
        for camera in cameras:
            for frame in range(3):
                path = silhouette_path(silhouette_folder(part, camera.name), frame)
                write_picture(path, ball_silhouette(camera, frame))
        frames = np.arange(3, dtype=np.int32)
        joints_take_m = to_take_world(joints_world_m, settings.up)
        write_joints_csv(part / REFERENCE_JOINTS_CSV, frames, frames / settings.fps, joints_take_m)
    take = open_take(tmp_path / "mine")
    assert take.settings == settings
    assert take.settings.facing_rad == pytest.approx(np.pi / 2)
    pose = take.settings.with_initial_pose(np.full(N_DOF, 7.0))
    assert sorted(pose) == [0.9, 1.0] + [7.0] * (N_DOF - 2)
    for camera, read in zip(cameras, take.cameras, strict=True):
        np.testing.assert_allclose(read.P_px_world, camera.P_px_world, atol=1e-9)
        for frame, trimap in enumerate(take.trimaps(read)):
            np.testing.assert_array_equal(trimap == ACTOR, ball_silhouette(camera, frame))
    table = read_joints_csv(tmp_path / "mine" / "reference" / "joints.csv")
    axes = [1, 2, 0] if up == "y" else [0, 1, 2]  # a y-up world's x, y, z are the inside world's y, z, x
    np.testing.assert_allclose(table.joints_take_m, joints_world_m[..., axes], atol=1e-9)


@pytest.mark.parametrize("clean_plate", ["video", "picture"])
def test_videos_show_the_actor_before_the_clean_plate(
    small_take: SmallTake, ball_silhouette: BallSilhouette, clean_plate: str
) -> None:
    take = open_take(small_take(clean_plate=clean_plate))
    assert take.source == "videos"
    for camera in take.cameras:
        plates = list(take.background(camera))
        assert len(plates) == (2 if clean_plate == "video" else 1)
        with take.video(camera, 1) as video:
            for frame, picture in enumerate(video, 1):
                red = picture[..., 2].astype(int) - plates[0][..., 1] > 50
                ball = ball_silhouette(camera, frame)
                # chroma has half the resolution: the outline may be off by a pixel
                ring = cv2.dilate(ball.astype(np.uint8), np.ones((5, 5))) - cv2.erode(
                    ball.astype(np.uint8), np.ones((5, 5))
                )
                np.testing.assert_array_equal(red[ring == 0], ball[ring == 0])


def test_silhouettes_win_over_videos(small_take: SmallTake) -> None:
    folder = small_take()
    for i in range(2):
        for frame in range(4):
            write_picture(folder / f"silhouettes/cam0{i + 1}/{frame:06d}.png", np.zeros((48, 64), np.bool_))
    shutil.rmtree(folder / "background")  # no longer needed
    take = open_take(folder)
    assert take.source == "silhouettes"
    assert take.has_video(take.cameras[0])
    (folder / "videos/cam02.mp4").unlink()  # only the overlay would use it
    assert not open_take(folder).has_video(take.cameras[1])


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TakeError, match="nowhere: is not a folder: expected a take folder"):
        open_take(tmp_path / "nowhere")


def test_a_bad_reference_is_found_before_the_work(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(n_cameras=1)
    (folder / "reference").mkdir()
    (folder / "reference/joints.csv").write_text("frame,time,tail_x\n0,0,0\n")
    assert refusal(folder).startswith("reference/joints.csv: 'tail_x': unknown column: ")


def test_a_take_is_written_whole_or_not_at_all(tmp_path: Path, small_cameras: SmallCameras) -> None:
    settings = TakeSettings(name="x", fps=10.0, units="m", up="z", frames=1)
    (camera,) = small_cameras(1)
    with pytest.raises(ZeroDivisionError), take_writer(tmp_path / "x", settings, [camera]) as part:
        with video_writer(video_path(part, camera.name), *camera.size_px, settings.fps) as video:
            video.write(np.zeros((48, 64, 3), np.uint8))
        raise ZeroDivisionError
    assert not any(tmp_path.iterdir())
