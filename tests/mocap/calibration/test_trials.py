"""A mistake in the calibration is found, whatever stands before one of the cameras."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.mocap.calibration.epipolar_tangents import Outlines, outline_of
from services.mocap.calibration.trials import undone_mistake
from services.mocap.camera.camera import Camera
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.folder import open_take
from services.mocap.types import ACTOR, Trimap

FRAMES, N_CAMERAS = 24, 6
BEHIND_A_CRATE = 5
"""The camera before which something stands: the lower half of the actor is hidden from it."""
OPENGL = np.diag([1.0, -1.0, -1.0])
BACKWARD = np.diag([-1.0, 1.0, -1.0])

Cameras = tuple[Camera, ...]
Seen = tuple[Cameras, Outlines]


@pytest.fixture(scope="module", params=[False, True], ids=["nothing in the way", "a crate"])
def seen(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """The cameras of a synthetic take, and their outlines."""
    folder = tmp_path_factory.mktemp("trials") / "walk"
    write_synthetic_take(folder, n_frames=FRAMES, n_cameras=N_CAMERAS)
    cameras = tuple(camera.undistorted() for camera in open_take(folder).cameras)
    outlines: Outlines = []
    for c, camera in enumerate(cameras):
        paths = sorted((folder / "reference" / "silhouettes" / camera.name).iterdir())
        trimaps = [_trimap(path, is_hidden=request.param and c == BEHIND_A_CRATE) for path in paths]
        outlines.append([outline_of(trimap, camera) for trimap in trimaps])
    return cameras, outlines


def _trimap(path: Path, *, is_hidden: bool) -> Trimap:
    trimap: Trimap = np.where(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 0, np.uint8(ACTOR), np.uint8(0))
    if is_hidden:
        rows = np.flatnonzero(trimap.any(axis=1))
        trimap[rows[len(rows) // 2] :] = 0
    return trimap


def _turned(camera: Camera, turn: np.ndarray) -> Camera:
    R, t_m = turn @ camera.R_camera_world, turn @ camera.t_camera_world_m
    return replace(camera, R_camera_world=R, t_camera_world_m=t_m)


def _inverse(camera: Camera) -> Camera:
    R = camera.R_camera_world.T
    return replace(camera, R_camera_world=R, t_camera_world_m=-R @ camera.t_camera_world_m)


def _with(n: int, turn: np.ndarray) -> Callable[[Cameras], Cameras]:
    return lambda cameras: (*cameras[:n], _turned(cameras[n], turn), *cameras[n + 1 :])


def _swapped(cameras: Cameras) -> Cameras:
    first, second, *others = cameras
    return (replace(second, name=first.name), replace(first, name=second.name), *others)


def _calibrated_as(wrong: Cameras, cameras: Cameras, outlines: Outlines) -> Outlines:
    """The outlines of the same pictures, as rays of cameras that are calibrated wrongly."""
    return [
        [outline and outline.in_camera(camera, other) for outline in of_camera]
        for of_camera, camera, other in zip(outlines, cameras, wrong, strict=True)
    ]


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_swapped, "cam01 and cam02 are swapped"),
        (lambda cameras: tuple(map(_inverse, cameras)), "read as the way from the camera to the world"),
        (lambda cameras: tuple(_turned(c, OPENGL) for c in cameras), "read as OpenGL's axes"),
        (
            lambda cameras: tuple(_inverse(_turned(c, OPENGL)) for c in cameras),
            "read as Blender's matrix_world",
        ),
        (_with(0, OPENGL), "[cam01] rotation: faces away from the actor"),
        (_with(3, BACKWARD), "[cam04] rotation: faces away from the actor"),
    ],
)
def test_the_mistake_is_named(seen: Seen, damage: Callable[[Cameras], Cameras], said: str) -> None:
    cameras, outlines = seen
    wrong = damage(cameras)
    mistake = undone_mistake(wrong, _calibrated_as(wrong, cameras, outlines), "z")
    assert mistake is not None and mistake.is_certain
    assert said in str(mistake)


@pytest.mark.parametrize(("flip", "said"), [((-1.0, -1.0), "upside down"), ((-1.0, 1.0), "mirrored")])
def test_flipped_pictures_are_named(seen: Seen, flip: tuple[float, float], said: str) -> None:
    cameras, outlines = seen
    of_third = [outline and outline.in_camera(cameras[2], flip=flip) for outline in outlines[2]]
    mistake = undone_mistake(cameras, [*outlines[:2], of_third, *outlines[3:]], "z")
    assert mistake is not None and mistake.is_certain
    assert f"[cam03]: its pictures are {said}" in str(mistake)


def test_two_cameras_prove_nothing(seen: Seen) -> None:
    cameras, outlines = seen
    tilted = _with(0, Rotation.from_rotvec([np.deg2rad(1.0), 0.0, 0.0]).as_matrix())(cameras)
    wrong = _calibrated_as(tilted, cameras, outlines)
    assert undone_mistake(tilted[:2], wrong[:2], "z") is None
    assert (
        undone_mistake(_swapped(cameras)[:2], _calibrated_as(_swapped(cameras), cameras, outlines)[:2], "z")
        is None
    )


@pytest.mark.parametrize("degrees", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("n", [0, 2, 4])
def test_a_bumped_camera_is_no_mistake_of_another_kind(seen: Seen, degrees: float, n: int) -> None:
    cameras, outlines = seen
    bump = np.random.default_rng(n).standard_normal(3)
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * bump / np.linalg.norm(bump)).as_matrix()
    bumped = _with(n, turn)(cameras)
    assert undone_mistake(bumped, _calibrated_as(bumped, cameras, outlines), "z") is None


def test_something_before_a_camera_is_no_mistake_of_the_calibration(seen: Seen) -> None:
    assert undone_mistake(*seen, "z") is None
