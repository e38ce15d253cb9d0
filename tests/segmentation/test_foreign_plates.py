"""Clean plates of other cameras are told, and light that changed is none."""

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


def _take(folder: Path, texture: float, brighter: float, plates: tuple[int, ...]) -> dict[str, str]:
    """What is found in a take whose plates are those of these cameras, and whose videos are brighter."""
    write_calibration(folder / "calibration.toml", CAMERAS, "z")
    (folder / "take.toml").write_text('name = "room"\nunits = "m"\nup = "z"\n')
    for c, camera in enumerate(CAMERAS):
        seen = np.asarray(np.clip(_scene(c, texture) * brighter, 0, 255), np.uint8)
        with video_writer(video_path(folder, camera.name), *camera.size_px, 15.0) as video:
            for _ in range(3):
                video.write(seen)
        path = background_video_path(folder, camera.name).with_suffix(".png")
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), _scene(plates[c], texture))
    return foreign_plates(open_take(folder))


@pytest.mark.parametrize("texture", [0.0, 0.3])
@pytest.mark.parametrize("brighter", [0.85, 1.0, 1.15])
def test_other_light_is_no_other_camera(tmp_path: Path, texture: float, brighter: float) -> None:
    assert _take(tmp_path, texture, brighter, (0, 1, 2, 3)) == {}


@pytest.mark.parametrize("brighter", [0.85, 1.15])
def test_exchanged_plates_are_named(tmp_path: Path, brighter: float) -> None:
    assert _take(tmp_path, 0.3, brighter, (2, 1, 0, 3)) == {"cam01": "cam03", "cam03": "cam01"}
