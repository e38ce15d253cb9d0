"""Fixtures that all tests share: the recorded takes, and small takes made on the spot."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import cv2
import hypothesis
import numpy as np
import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import LOWER, UPPER
from services.mocap.camera.camera import Camera
from services.mocap.compiled import compiled_folder
from services.mocap.errors import TakeError
from services.mocap.synth.walk import walk
from services.mocap.take import layout
from services.mocap.take.actor_file import write_actor
from services.mocap.take.folder import open_take
from services.mocap.take.marks import Marks
from services.mocap.take.settings import TakeSettings
from services.mocap.take.tables import PoseTable, write_poses_csv
from services.mocap.take.writer import REPRODUCIBLE, take_writer, video_writer, write_picture
from services.mocap.types import Bytes, Floats, Mask

# Shared machines are too noisy for deadlines. Continuous integration tries the same examples every time,
# runs by hand look for new ones.
hypothesis.settings.register_profile("by_hand", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "by_hand")

_SHARED_TAKES = Path(__file__).resolve().parents[2] / "shared" / "data" / "takes"
_WIDTH_PX, _HEIGHT_PX = 64, 48
_BALL_RADIUS_M = 0.35


_TOGETHER = ("containers", "integration", "viewer")
"""Folders whose tests share what takes long to make; each runs in one process, the slowest first."""


class Sharing(LoadScopeScheduling):
    """How pytest-xdist shares tests out: a file, or one of some folders, goes to one process."""

    def _split_scope(self, nodeid: str) -> str:
        path = nodeid.partition("::")[0]
        return next((folder for folder in _TOGETHER if f"/{folder}/" in path), path)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    """What pytest-xdist shares tests out by, in place of what --dist says."""
    return Sharing(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The slowest folders first, since nothing else can be done beside the last of them."""
    items.sort(key=lambda item: [f"/{folder}/" in item.nodeid for folder in _TOGETHER], reverse=True)


@pytest.fixture(scope="session", autouse=True)
def level_cache(request: pytest.FixtureRequest) -> Iterator[None]:
    """Keeps thinned bodies, those of the processes that tests start as well, until the sources change."""
    assert request.config.cache is not None
    kept = request.config.cache.mkdir("levels")
    for other in kept.iterdir():
        if other.name != compiled_folder().name:
            shutil.rmtree(other, ignore_errors=True)
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("XORMOCAP_CACHE", str(kept / compiled_folder().name))
        yield


@pytest.fixture(scope="session")
def shared_takes() -> Path:
    """The folder of recorded takes; tests that use it are skipped where it is missing."""
    if not _SHARED_TAKES.is_dir():
        pytest.skip("the shared takes are not there")
    return _SHARED_TAKES


def _ring_camera(name: str, angle_rad: float) -> Camera:
    """A pinhole 4 m from the middle, 1.5 m up, that looks at a point 1 m over the floor."""
    centre_world_m = np.array([4 * np.cos(angle_rad), 4 * np.sin(angle_rad), 1.5])
    ahead = np.array([0.0, 0.0, 1.0]) - centre_world_m
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R_camera_world = np.array([right, np.cross(ahead, right), ahead])
    return Camera(
        name=name,
        width_px=_WIDTH_PX,
        height_px=_HEIGHT_PX,
        K=np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]]),
        distortion=np.zeros(4),
        R_camera_world=R_camera_world,
        t_camera_world_m=-R_camera_world @ centre_world_m,
    )


def _ball_silhouette(camera: Camera, frame: int) -> Mask:
    centre_world_m: Floats = np.array([0.0, 0.1 * frame - 0.2, 1.0])
    disc = np.zeros(camera.shape_px, np.uint8)
    distance_m = np.linalg.norm(centre_world_m - camera.centre_world_m)
    x, y = np.rint(camera.project_px(centre_world_m)).astype(int)
    cv2.circle(disc, (int(x), int(y)), round(camera.K[0, 0] * _BALL_RADIUS_M / distance_m), 1, cv2.FILLED)
    return disc > 0


@pytest.fixture
def small_cameras() -> Callable[[int], list[Camera]]:
    """`small_cameras(n)`: the cameras cam01, cam02, … of 64x48 pixels, evenly around the stage."""
    return lambda n: [_ring_camera(f"cam{i + 1:02d}", 2 * np.pi * i / n) for i in range(n)]


@pytest.fixture
def ball_silhouette() -> Callable[[Camera, int], Mask]:
    """`ball_silhouette(camera, frame)`: the (H, W) silhouette of the ball that acts in the small takes."""
    return _ball_silhouette


def _background() -> Bytes:
    columns = np.linspace(60, 160, _WIDTH_PX).astype(np.uint8)
    return np.repeat(np.tile(columns, (_HEIGHT_PX, 1))[..., None], 3, axis=2)


def _write_camera(folder: Path, camera: Camera, fps: float, frames: int, clean_plate: str) -> None:
    if clean_plate == "video":
        plate_path = layout.background_video_path(folder, camera.name)
        with video_writer(plate_path, *camera.size_px, fps, options=REPRODUCIBLE) as plate:
            plate.write(_background())
            plate.write(_background())
    else:
        write_picture(folder / layout.BACKGROUND / f"{camera.name}.png", _background())
    with video_writer(
        layout.video_path(folder, camera.name), *camera.size_px, fps, options=REPRODUCIBLE
    ) as video:
        for frame in range(frames):
            picture = _background()
            picture[_ball_silhouette(camera, frame)] = (30, 60, 220)
            video.write(picture)


@pytest.fixture
def small_take(tmp_path: Path, small_cameras: Callable[[int], list[Camera]]) -> Callable[..., Path]:
    """Makes a take of a red ball that moves along y before grey walls: 64x48 pixels, 10 frames per second.

    `small_take(name, n_cameras=2, frames=4, source="videos" | "silhouettes", clean_plate="video" |
    "picture", **fields of TakeSettings)` returns the folder; cameras are named cam01, cam02 and so on.
    """

    def make(
        name: str = "small",
        *,
        n_cameras: int = 2,
        frames: int = 4,
        source: Literal["videos", "silhouettes"] = "videos",
        clean_plate: Literal["video", "picture"] = "video",
        **fields: Any,
    ) -> Path:
        given = {"name": name, "fps": 10.0, "units": "m", "up": "z", "frames": frames, **fields}
        cameras = small_cameras(n_cameras)
        settings = TakeSettings(**given)
        with take_writer(tmp_path / name, settings, cameras) as part:
            for camera in cameras:
                if source == "videos":
                    _write_camera(part, camera, settings.fps, frames, clean_plate)
                    continue
                for frame in range(frames):
                    path = layout.silhouette_path(layout.silhouette_folder(part, camera.name), frame)
                    write_picture(path, _ball_silhouette(camera, frame))
        return tmp_path / name

    return make


@pytest.fixture(scope="session")
def bare_result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results with nothing but poses.csv and actor.toml: 10 frames of walking, then 6 wild ones.

    The frames are 100 to 115 of 29.97 a second; the wild poses are anywhere within the limits.
    """
    folder, fps = tmp_path_factory.mktemp("bare") / "result", 29.97
    actor = Actor(height=1.78, bone_lengths={"thigh": 0.45})
    rng = np.random.default_rng(7)
    wild = rng.uniform(np.where(np.isinf(LOWER), -4, LOWER), np.where(np.isinf(UPPER), 4, UPPER), (6, N_DOF))
    poses = np.vstack([walk(10, fps, build_body(actor)), wild])
    frames = np.arange(100, 116, dtype=np.int32)
    distrusted = np.zeros((16, 6), bool)
    distrusted[3, 2] = True
    marks = Marks(np.full((16, 6), 0.9), distrusted)
    table = PoseTable(frames, frames / fps, poses, rng.uniform(500, 900, 16), marks=marks)
    write_poses_csv(folder / "poses.csv", table)
    write_actor(folder / "actor.toml", actor, "nothing")
    return folder


@pytest.fixture
def refusal() -> Callable[[Path], str]:
    """`refusal(folder)`: the sentence with which open_take refuses a take, without the folder's name."""

    def sentence_of(folder: Path) -> str:
        with pytest.raises(TakeError) as refused:
            open_take(folder)
        sentence = str(refused.value)
        assert sentence.startswith(f"{folder}/"), sentence
        assert "\n" not in sentence
        assert ". " not in sentence
        return sentence.removeprefix(f"{folder}/")

    return sentence_of
