"""Clean plates of other cameras are told, and light that changed is none."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from services.mocap.camera.calibration import write_calibration
from services.mocap.synth.studio import studio_cameras
from services.mocap.take.folder import open_take
from services.mocap.take.layout import background_video_path, video_path
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes
from services.segmentation.foreign_plates import foreign_plates

CAMERAS = studio_cameras(4)


def _scene(camera: int, texture: float) -> Bytes:
    """(240, 320, 3) a wall that is darker in the corners, lit a little differently in every camera."""
    rng = np.random.default_rng(camera)
    y, x = np.mgrid[-1:1:240j, -1:1:320j]
    blobs = cv2.resize(rng.normal(size=(12, 16)), (320, 240), interpolation=cv2.INTER_CUBIC)
    level = (0.94 + 0.04 * camera) * (1 - 0.2 * (x**2 + y**2)) * (1 + texture * blobs)
    return np.asarray(np.clip(level[..., None] * (60, 140, 70), 0, 200), np.uint8)


def _found(folder: Path, plates: Sequence[Bytes], videos: Sequence[Bytes]) -> dict[str, str]:
    """What is found in a take with these clean plates and videos of these pictures (240, 320, 3)."""
    cameras = CAMERAS[: len(plates)]
    write_calibration(folder / "calibration.toml", cameras, "z")
    (folder / "take.toml").write_text('name = "room"\nunits = "m"\nup = "z"\n')
    for camera, plate, seen in zip(cameras, plates, videos, strict=True):
        with video_writer(video_path(folder, camera.name), *camera.size_px, 15.0) as video:
            for _ in range(3):
                video.write(seen)
        path = background_video_path(folder, camera.name).with_suffix(".png")
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), plate)
    return foreign_plates(open_take(folder))


def _brightened(picture: Bytes, times: float) -> Bytes:
    return np.asarray(np.clip(picture * times, 0, 255), np.uint8)


@pytest.mark.parametrize("texture", [0.0, 0.3])
@pytest.mark.parametrize("times", [0.5, 0.85, 1.0, 1.15])
def test_other_light_is_no_other_camera(tmp_path: Path, texture: float, times: float) -> None:
    plates = [_scene(camera, texture) for camera in range(4)]
    assert _found(tmp_path, plates, [_brightened(plate, times) for plate in plates]) == {}


@pytest.mark.parametrize("times", [0.0, 0.1, 0.2, 1.8])
def test_a_first_picture_that_is_black_or_clipped_proves_nothing(tmp_path: Path, times: float) -> None:
    plates = [_scene(camera, 0.05) for camera in range(4)]
    assert _found(tmp_path, plates, [_brightened(plates[0], times), *plates[1:]]) == {}


def test_a_black_picture_is_not_what_another_plate_shows(tmp_path: Path) -> None:
    """A plate that was recorded with other settings differs from its own video by more than from black."""
    plates = [_scene(camera, 0.3) for camera in range(4)]
    videos = [_brightened(plates[0], 0.0), *plates[1:]]
    contrasty = np.asarray(255 * (plates[2] / 255.0) ** 1.4, np.uint8)
    assert _found(tmp_path, [*plates[:2], contrasty, plates[3]], videos) == {}


@pytest.mark.parametrize("texture", [0.05, 0.3])
@pytest.mark.parametrize("times", [0.85, 1.15])
def test_exchanged_plates_are_named(tmp_path: Path, texture: float, times: float) -> None:
    scenes = [_scene(camera, texture) for camera in range(4)]
    found = _found(
        tmp_path, [scenes[c] for c in (2, 1, 0, 3)], [_brightened(scene, times) for scene in scenes]
    )
    assert found == {"cam01": "cam03", "cam03": "cam01"}


def test_the_plate_of_another_camera_as_well_is_named(tmp_path: Path) -> None:
    scenes = [_scene(camera, 0.3) for camera in range(4)]
    assert _found(tmp_path, [scenes[c] for c in (0, 0, 2, 3)], scenes) == {"cam02": "cam01"}


def test_an_actor_before_half_of_the_floor_makes_no_other_camera(tmp_path: Path) -> None:
    """Floor and wall are nearly equal in area: the actor decides to which the median level belongs."""
    plates = [np.full((240, 320, 3), 60, np.uint8) for _ in range(2)]
    for plate, horizon in zip(plates, (116, 100), strict=True):
        plate[horizon:] = 150
    videos = [plate.copy() for plate in plates]
    videos[0][40:220, 130:190] = 50
    assert _found(tmp_path, plates, videos) == {}


@pytest.mark.parametrize("texture", [0.05, 0.3])
def test_a_plate_that_shows_its_video_upside_down_is_named(tmp_path: Path, texture: float) -> None:
    """And not said to be another camera's, whose view may be more alike than that."""
    plates = [_scene(camera, texture) for camera in range(4)]
    floor = np.linspace(0.6, 1.2, 240)[:, None, None]
    plates = [np.asarray(np.clip(plate * floor, 0, 200), np.uint8) for plate in plates]
    videos = [plate[::-1, ::-1] if camera == 2 else plate for camera, plate in enumerate(plates)]
    assert _found(tmp_path, plates, videos) == {CAMERAS[2].name: CAMERAS[2].name}
