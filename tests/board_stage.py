"""A synthetic stage on which a board is moved about: cameras, board poses, what is seen, pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.calibration.board import Board, drawn
from services.mocap.calibration.rig_solving import ORIGIN_FRAME
from services.mocap.calibration.rigid_transform import RigidTransform
from services.mocap.calibration.sightings import Sighting, Sightings
from services.mocap.camera.camera import Camera
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes, Floats

FLAT = RigidTransform(np.eye(3), np.zeros(3))
"""On the floor, in the middle."""
_SQUARE_PX = 32
CAMERA_CRF = 20
"""x264's quality of clips: about what cameras write."""
_STEEPEST = 0.35
"""Cosine between a board's normal and the direction to a camera, below which it is not read."""


def ring(
    n: int, width_px: int, height_px: int, rng: np.random.Generator, of: int | None = None
) -> list[Camera]:
    """n neighbours of a ring of `of` cameras 4 m from the middle, each with a lens of its own."""
    cameras = []
    for i in range(n):
        angle = 2 * np.pi * (i + 0.5) / (of or n)
        centre_m = np.array([4 * np.cos(angle), 4 * np.sin(angle), rng.uniform(1.2, 2.4)])
        ahead = np.array([0.0, 0.0, 1.0]) - centre_m
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(ahead, right), ahead])
        focal_px = width_px * rng.uniform(0.7, 0.85)
        cx, cy = (width_px - 1) / 2, (height_px - 1) / 2
        shift = 0.008 * width_px * rng.standard_normal(2)
        K = np.array([[focal_px, 0, cx + shift[0]], [0, focal_px, cy + shift[1]], [0, 0, 1]])
        lens = np.array([-0.1, 0.05, 0.001, -0.0005]) * rng.uniform(0.5, 1.5)
        cameras.append(Camera(f"cam{i + 1:02d}", width_px, height_px, K, lens, R, -R @ centre_m))
    return cameras


def between(one: Camera, other: Camera, rng: np.random.Generator) -> RigidTransform:
    """T_world_board of a board held up to two cameras."""
    middle_m = (one.centre_world_m + other.centre_world_m) / 2
    at_m = middle_m * rng.uniform(0.0, 0.65) + 0.5 * rng.standard_normal(3)
    at_m[2] = rng.uniform(0.2, 1.9)
    towards = middle_m - at_m
    towards = towards / np.linalg.norm(towards) + 0.4 * rng.standard_normal(3)
    towards /= np.linalg.norm(towards)
    side = np.cross(rng.standard_normal(3), towards)
    side /= np.linalg.norm(side)
    return RigidTransform(np.stack([side, np.cross(towards, side), towards], axis=1), at_m)


def distorted_px(camera: Camera, points_world_m: Floats) -> Floats:
    """Raw pixels (N, 2) of world points (N, 3)."""
    turn, _ = cv2.Rodrigues(camera.R_camera_world)
    project = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
    order = (points_world_m[:, None], turn, camera.t_camera_world_m)
    return project(*order, camera.K, camera.distortion)[0].reshape(-1, 2)


def sees(camera: Camera, board: Board, pose: RigidTransform, steepest: float = _STEEPEST) -> bool:
    """Whether the print faces a camera that is not too near."""
    away_m = camera.centre_world_m - pose.t_m
    distance_m = np.linalg.norm(away_m)
    depth_m = (pose.apply(board.outline_m) @ camera.R_camera_world.T + camera.t_camera_world_m)[:, 2].min()
    return bool(depth_m > 0.4 and pose.R[:, 2] @ away_m > steepest * distance_m)


def look(
    camera: Camera, board: Board, pose: RigidTransform, noise_px: float, rng: np.random.Generator
) -> Sighting | None:
    """The corners that a camera sees, with noise; None where too few are in its picture."""
    if not sees(camera, board, pose):
        return None
    points_px = distorted_px(camera, pose.apply(board.corners_m))
    inside = np.all((points_px > 2) & (points_px < (camera.width_px - 3, camera.height_px - 3)), axis=1)
    if inside.sum() < 12:
        return None
    noise = noise_px * rng.standard_normal((int(inside.sum()), 2))
    return Sighting(np.flatnonzero(inside).astype(np.int32), points_px[inside] + noise)


@dataclass(frozen=True)
class Scene:
    """Cameras, and where the board is in each moment."""

    cameras: list[Camera]
    board: Board
    moments: list[tuple[RigidTransform, tuple[int, ...]]]
    """T_world_board, and the cameras that may see it."""


def shown_to_neighbours(
    cameras: list[Camera], board: Board, per_pair: int, rng: np.random.Generator, closed: bool = True
) -> Scene:
    """A board shown to each camera and the next one alone, so many times."""
    moments = []
    for a in range(len(cameras) if closed else len(cameras) - 1):
        b = (a + 1) % len(cameras)
        shown = 0
        while shown < per_pair:
            pose = between(cameras[a], cameras[b], rng)
            if all(look(cameras[c], board, pose, 0.0, rng) is not None for c in (a, b)):
                moments.append((pose, (a, b)))
                shown += 1
    return Scene(cameras, board, moments)


def sightings_of(
    scene: Scene, noise_px: float, rng: np.random.Generator, at_origin: int = 20
) -> list[Sightings]:
    """What all cameras see; the board lies at the origin for so many pictures, of which the median counts."""
    seen = []
    for c, camera in enumerate(scene.cameras):
        by_frame = {
            frame: sighting
            for frame, (pose, to) in enumerate(scene.moments)
            if c in to and (sighting := look(camera, scene.board, pose, noise_px, rng)) is not None
        }
        still = look(camera, scene.board, FLAT, noise_px / np.sqrt(at_origin), rng)
        if still is not None:
            by_frame[ORIGIN_FRAME] = still
        size_px = camera.size_px
        seen.append(Sightings(camera.name, size_px, by_frame, len(scene.moments)))
    return seen


@cache
def _rays(camera: Camera) -> Floats:
    """(H * W, 3) rays through a camera's pixels, at depth 1."""
    y, x = np.indices(camera.shape_px, np.float64)
    raw_px = np.stack([x.ravel(), y.ravel()], axis=1)
    undistort = cv2.fisheye.undistortPoints if camera.fisheye else cv2.undistortPoints
    rays = undistort(raw_px[:, None], camera.K, camera.distortion).reshape(-1, 2)
    return np.column_stack([rays, np.ones(len(rays))])


def picture(
    camera: Camera, board: Board, pose: RigidTransform | None, rng: np.random.Generator, noise: float = 2.0
) -> Bytes:
    """A grey picture (H, W, 3) of the board before a dim background, with lens distortion, soft and noisy."""
    level = np.full(camera.shape_px, 90.0, np.float32)
    if pose is not None and sees(camera, board, pose, 0.1):
        T_camera_board = RigidTransform(camera.R_camera_world, camera.t_camera_world_m) @ pose
        to_board = np.linalg.inv(np.column_stack([T_camera_board.R[:, :2], T_camera_board.t_m]))
        plane = _rays(camera) @ to_board.T
        print_ = cv2.GaussianBlur(drawn(board, _SQUARE_PX), (0, 0), 0.7)
        centre = (np.array(print_.shape[::-1]) - 1) / 2
        at_px = plane[:, :2] / plane[:, 2:] * (1, -1) / board.pitch_m * _SQUARE_PX + centre
        x, y = at_px.astype(np.float32).T.reshape(2, *level.shape)
        level = 20 + 0.8 * cv2.remap(print_, x, y, cv2.INTER_LINEAR, borderValue=90).astype(np.float32)
    grey = level + noise * rng.standard_normal(level.shape, np.float32)
    return np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def write_pictures(
    folder: Path,
    scene: Scene,
    rng: np.random.Generator,
    change: Callable[[int, Bytes], Bytes] = lambda _, p: p,
) -> None:
    """<camera>/000000.png and origin/<camera>.png of all cameras; change(camera, picture) may spoil them."""
    for c, camera in enumerate(scene.cameras):
        for frame, (pose, to) in enumerate(scene.moments):
            if c in to:
                write(
                    folder / camera.name / f"{frame:06d}.png",
                    change(c, picture(camera, scene.board, pose, rng)),
                )
        write(folder / "origin" / f"{camera.name}.png", change(c, picture(camera, scene.board, FLAT, rng)))


def write_clips(folder: Path, scene: Scene, rng: np.random.Generator, still: int = 3) -> None:
    """<camera>.mp4, all equally long, and origin/<camera>.mp4 of all cameras."""
    (folder / "origin").mkdir(parents=True)
    for c, camera in enumerate(scene.cameras):
        size = camera.size_px
        with video_writer(folder / f"{camera.name}.mp4", *size, 10.0, CAMERA_CRF) as video:
            for pose, to in scene.moments:
                video.write(picture(camera, scene.board, pose if c in to else None, rng))
        with video_writer(folder / "origin" / f"{camera.name}.mp4", *size, 10.0, CAMERA_CRF) as video:
            for _ in range(still):
                video.write(picture(camera, scene.board, FLAT, rng))


def with_fisheye(camera: Camera, rng: np.random.Generator) -> Camera:
    """The same camera with a lens that bends: OpenCV's fisheye model, and a shorter focal length."""
    K = camera.K.copy()
    K[0, 0] = K[1, 1] = 0.8 * K[0, 0]
    lens = np.array([0.05, -0.02, 0.01, -0.004]) * rng.uniform(0.7, 1.3)
    return replace(camera, K=K, distortion=lens, fisheye=True)


def write(path: Path, pixels: Bytes) -> None:
    """A PNG, and its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())


def turn_of(found: Camera, true: Camera) -> float:
    """How far two cameras' directions are apart, in radians."""
    return float(Rotation.from_matrix(found.R_camera_world @ true.R_camera_world.T).magnitude())


def centres_apart_m(found: Sequence[Camera], true: Sequence[Camera]) -> Floats:
    """(C,) how far camera centres are apart."""
    return np.array(
        [np.linalg.norm(f.centre_world_m - t.centre_world_m) for f, t in zip(found, true, strict=True)]
    )
