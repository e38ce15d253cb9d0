from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from reference_rasteriser import rasterise
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.errors import UserError
from services.mocap.synth.render import NOISE, Model
from services.mocap.synth.take import BACKGROUND_FRAMES, write_synthetic_take
from services.mocap.synth.walk import walk
from services.mocap.take.folder import open_take
from services.mocap.take.pictures import read_silhouette
from services.mocap.take.tables import REFERENCE_JOINTS, read_joints_csv, read_poses_csv
from services.mocap.take.writer import VideoWriter
from services.mocap.types import Bytes, Floats

write_tiny = partial(write_synthetic_take, n_frames=3, n_cameras=2)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("synth") / "tiny"
    write_tiny(folder)
    return folder


def test_opens_as_a_take(tiny: Path) -> None:
    take = open_take(tiny)
    assert (take.settings.name, take.settings.fps, take.settings.up) == ("tiny", 15.0, "z")
    assert (take.settings.frames, take.settings.init_frames, take.settings.actor_height) == (3, 3, 1.75)
    for camera in take.cameras:
        assert len(list(take.background(camera))) == BACKGROUND_FRAMES
        with take.video(camera) as video:
            assert [picture.shape for picture in video] == [(240, 320, 3)] * 3


def test_references_are_the_body_in_its_poses(tiny: Path) -> None:
    body = build_body(Actor(height=1.75))
    table = read_poses_csv(tiny / "reference/poses.csv")
    np.testing.assert_allclose(table.poses, walk(3, 15, body), atol=1e-6)
    np.testing.assert_allclose(table.times_s, np.arange(3) / 15, atol=1e-6)
    rows = [JOINT_INDEX[name] for name in REFERENCE_JOINTS]
    joints_world_m = joint_positions(table.poses, body.offsets_m)[:, rows]
    found = read_joints_csv(tiny / "reference/joints.csv")
    np.testing.assert_allclose(found.joints_take_m, joints_world_m, atol=2e-5)


def test_silhouettes_are_those_of_the_model_through_the_written_calibration(tiny: Path) -> None:
    take, body = open_take(tiny), build_body(Actor(height=1.75))
    figure = Model(body).pose(walk(3, 15, body)[1])
    for camera in take.cameras:
        folder = tiny / "reference/silhouettes" / camera.name
        assert sorted(file.name for file in folder.iterdir()) == ["000000.png", "000001.png", "000002.png"]
        written = read_silhouette(folder / "000001.png")
        expected = rasterise(figure.vertices_world_m, figure.faces, camera.P_px_world, 320, 240)
        # calibration.toml rounds, so that a vertex may snap to the next of 256 steps in a pixel
        assert np.count_nonzero(written != expected) <= 2


def test_the_video_shows_the_actor_before_the_clean_plate(tiny: Path) -> None:
    take = open_take(tiny)
    for camera in take.cameras:
        plate = np.mean([picture.astype(np.float64) for picture in take.background(camera)], axis=0)
        silhouette = read_silhouette(tiny / "reference/silhouettes" / camera.name / "000000.png")
        with take.video(camera) as video:
            difference: Floats = np.abs(next(iter(video)) - plate).max(axis=2)
        around = cv2.dilate(silhouette.astype(np.uint8), np.ones((61, 61), np.uint8)) > 0
        assert np.median(difference[silhouette]) > 12 * NOISE
        assert np.median(difference[~around]) < 2 * NOISE


def _pictures_written(folder: Path, seed: int, monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """Write a tiny take and keep the pictures of its videos: x264 may code equal ones to other bytes."""
    pictures: list[bytes] = []
    write = VideoWriter.write

    def keep(self: VideoWriter, picture_bgr: Bytes) -> None:
        pictures.append(picture_bgr.tobytes())
        write(self, picture_bgr)

    with monkeypatch.context() as patch:
        patch.setattr(VideoWriter, "write", keep)
        write_synthetic_take(folder, seed=seed, n_frames=2, n_cameras=1)
    return pictures


def test_one_seed_is_one_take_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, again, other = tmp_path / "one/take", tmp_path / "again/take", tmp_path / "other/take"
    pictures = _pictures_written(one, 7, monkeypatch)
    assert len(pictures) == BACKGROUND_FRAMES + 2
    assert _pictures_written(again, 7, monkeypatch) == pictures
    changed = zip(_pictures_written(other, 8, monkeypatch), pictures, strict=True)
    assert all(a != b for a, b in changed)
    files = [path.relative_to(one) for path in sorted(one.rglob("*")) if path.is_file()]
    assert files == [path.relative_to(again) for path in sorted(again.rglob("*")) if path.is_file()]
    for file in files:
        assert (one / file).read_bytes() == (again / file).read_bytes(), file


def test_tells_how_far_it_is(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    write_synthetic_take(
        tmp_path / "take", n_frames=2, n_cameras=1, progress=lambda done, total: calls.append((done, total))
    )
    assert calls == [(1, 2), (2, 2)]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"n_frames": 0}, "synth: frames = 0: expected 1 or more"),
        ({"fps": 0.0}, "synth: fps = 0.0: expected 1 to 240 frames per second"),
        ({"seed": -1}, "synth: seed = -1: expected 0 or more"),
        ({"height_m": 2.3}, "synth: height = 2.3: expected 1.0 to 1.9 m, what the studio's pictures hold"),
        ({"n_cameras": 0}, "synth: cameras = 0: expected 1 to 64"),
    ],
)
def test_refuses_in_one_sentence(tmp_path: Path, arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UserError) as error:
        write_synthetic_take(tmp_path / "take", **arguments)
    assert str(error.value) == sentence
    assert not (tmp_path / "take").exists()


def test_leaves_a_folder_that_is_there_alone(tmp_path: Path) -> None:
    (tmp_path / "take").mkdir()
    (tmp_path / "take/mine.txt").write_text("mine")
    with pytest.raises(UserError, match="already exists"):
        write_tiny(tmp_path / "take")
    assert [path.name for path in (tmp_path / "take").iterdir()] == ["mine.txt"]
