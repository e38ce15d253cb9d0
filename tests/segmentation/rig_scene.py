"""A made-up room that several cameras look into: what is in it, and the pictures, by casting rays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, UNSURE, Bytes, Floats, Mask, Trimap
from services.segmentation.joint import JointMatte
from services.segmentation.plate import LIGHT_UNCERTAINTY, Plate

LAMP_M = np.array([1.5, -1.0, 5.0])
SHADOW = 0.6
_HALF_ROOM_M, _TEXEL_M = 5.0, 0.02
_SUB = 2
"""Rays per pixel along either axis."""

Colour = tuple[float, float, float]
DARK_GREY: Colour = (78.0, 76.0, 74.0)
BLUE: Colour = (150.0, 70.0, 40.0)
SKIN: Colour = (110.0, 140.0, 195.0)
GREEN: Colour = (60.0, 130.0, 50.0)


@dataclass(frozen=True, eq=False)
class Blob:
    """An ellipsoid."""

    centre_m: tuple[float, float, float]
    radii_m: tuple[float, float, float]
    colour: Colour


def person(clothes: Colour = DARK_GREY, skin: Colour = SKIN, x: float = 0.0, y: float = 0.0) -> list[Blob]:
    """Somebody who stands with arms held out along x, over a place on the floor at height 0."""
    return [
        Blob((x, y, 1.15), (0.2, 0.15, 0.36), clothes),
        Blob((x, y, 1.65), (0.1, 0.11, 0.14), skin),
        Blob((x - 0.11, y, 0.45), (0.09, 0.1, 0.48), clothes),
        Blob((x + 0.11, y, 0.45), (0.09, 0.1, 0.48), clothes),
        Blob((x - 0.42, y, 1.36), (0.34, 0.07, 0.07), clothes),
        Blob((x + 0.42, y, 1.36), (0.34, 0.07, 0.07), clothes),
    ]


def raised(blobs: Sequence[Blob], by_m: float) -> list[Blob]:
    return [replace(b, centre_m=(b.centre_m[0], b.centre_m[1], b.centre_m[2] + by_m)) for b in blobs]


def ring(
    n: int, width_px: int = 240, height_px: int = 180, lens: tuple[float, ...] = (0.0,) * 4
) -> list[Camera]:
    """n cameras 3.6 m from the middle, at heights of their own, that look at it."""
    cameras = []
    for i in range(n):
        angle = 2 * np.pi * (i + 0.3) / n
        centre_m = np.array([3.6 * np.cos(angle), 3.6 * np.sin(angle), 1.3 + 0.35 * (i % 3)])
        ahead = np.array([0.0, 0.0, 0.85]) - centre_m
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(ahead, right), ahead])
        focal_px = 0.78 * width_px
        K = np.array([[focal_px, 0, (width_px - 1) / 2], [0, focal_px, (height_px - 1) / 2], [0, 0, 1]])
        cameras.append(Camera(f"cam{i + 1:02d}", width_px, height_px, K, np.array(lens), R, -R @ centre_m))
    return cameras


def _rays(camera: Camera) -> Floats:
    """(H * _SUB, W * _SUB, 3) directions in the world of the rays of raw pixels, in parts."""
    offsets = (np.arange(_SUB) + 0.5) / _SUB - 0.5
    columns = (np.arange(camera.width_px)[:, None] + offsets).ravel()
    rows = (np.arange(camera.height_px)[:, None] + offsets).ravel()
    raw = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 1, 2)
    undo = cv2.fisheye.undistortPoints if camera.fisheye else cv2.undistortPoints
    flat = undo(raw, camera.K, camera.distortion).reshape(-1, 2)
    rays = np.column_stack([flat, np.ones(len(flat))]) @ camera.R_camera_world
    return np.asarray(rays.reshape(len(rows), len(columns), 3))


def _hit(origin: Floats, rays: Floats, lengths_m2: Floats, blob: Blob) -> Floats:
    """How far along rays (N, 3) from a point a blob is met; infinite where it is not, or lies behind.

    lengths_m2 (N,): the squared lengths of the rays.
    """
    met = np.full(len(rays), np.inf)
    radii_m = np.array(blob.radii_m)
    to_blob = np.array(blob.centre_m) - origin
    ahead = rays @ to_blob
    reach_m2 = to_blob @ to_blob - radii_m.max() ** 2
    near = np.flatnonzero((ahead > 0) & (ahead * ahead > reach_m2 * lengths_m2))
    away, along = -to_blob / radii_m, rays[near] / radii_m
    a, b, c = np.einsum("ni,ni->n", along, along), along @ away, away @ away - 1
    inside = b * b - a * c
    met[near] = np.where(inside > 0, (-b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)
    return met


@cache
def _texture() -> Floats:
    """(N, N) brightness of the room's surfaces over their mean."""
    rng = np.random.default_rng(3)
    size = round(6 * _HALF_ROOM_M / _TEXEL_M)
    coarse = cv2.GaussianBlur(rng.normal(0, 1, (size, size)), (0, 0), 9)
    fine = cv2.GaussianBlur(rng.normal(0, 1, (size, size)), (0, 0), 2)
    texture = 1 + 0.08 * coarse / coarse.std() + 0.03 * fine / fine.std()
    texture[:: round(1.0 / _TEXEL_M)] *= 0.9  # joints, a metre apart
    return np.asarray(np.clip(texture, 0.6, 1.4))


def _room(origin: Floats, rays: Floats, floor_m: float) -> tuple[Floats, Floats]:
    """How far along rays (N, 3) the room's surface is, and its colours (N, 3) in light."""
    met, colours = np.full(len(rays), np.inf), np.zeros(rays.shape)
    surfaces = [(2, floor_m, (135.0, 132.0, 128.0))]
    surfaces += [(0, side * _HALF_ROOM_M, (120.0 + 12 * side, 122.0, 126.0)) for side in (-1, 1)]
    surfaces += [(1, side * _HALF_ROOM_M, (118.0, 120.0 + 8 * side, 116.0)) for side in (-1, 1)]
    for number, (axis, at_m, colour) in enumerate(surfaces):
        with np.errstate(divide="ignore"):
            along = (at_m - origin[axis]) / rays[..., axis]
        along = np.where(along > 0, along, np.inf)
        nearer = along < met
        if not nearer.any():
            continue
        met[nearer] = along[nearer]
        points = origin + along[nearer][:, None] * rays[nearer]
        across, up = (points[:, k] for k in range(3) if k != axis)
        size = len(_texture())
        u = np.rint((across + 2 * _HALF_ROOM_M) / _TEXEL_M + 37 * number).astype(int) % size
        v = np.rint((up + 2 * _HALF_ROOM_M) / _TEXEL_M + 91 * number).astype(int) % size
        colours[nearer] = _texture()[v, u][:, None] * colour
    return met, colours


@dataclass(frozen=True, eq=False)
class Rendered:
    """What one camera sees."""

    colours: Floats
    """(H, W, 3) before noise."""
    actor: Mask
    """(H, W) where blobs cover more than half of a pixel."""
    shadow: Mask
    """(H, W) where there is shadow on the room, and no blob."""


@lru_cache(maxsize=8)
def _empty(camera: Camera, floor_m: float) -> tuple[Floats, Floats, Floats]:
    """A camera's rays (N, 3) into the empty room, how far along them its surface is, its colours there."""
    rays = _rays(camera).reshape(-1, 3)
    return (rays, *_room(camera.centre_world_m, rays, floor_m))


def render(camera: Camera, blobs: Sequence[Blob] = (), floor_m: float = 0.0) -> Rendered:
    """Cast rays into the room, in which blobs throw a shadow on the floor."""
    origin = camera.centre_world_m
    rays, met, colours = (array.copy() for array in _empty(camera, floor_m))
    points = origin + met[:, None] * rays
    on_floor = np.flatnonzero(np.abs(points[:, 2] - floor_m) < 1e-6)
    dark, seen = np.zeros((2, len(rays)), bool)
    from_lamp = points[on_floor] - LAMP_M
    squares = np.einsum("ni,ni->n", from_lamp, from_lamp)
    for blob in blobs:
        dark[on_floor] |= _hit(LAMP_M, from_lamp, squares, blob) < 1
    colours[dark] *= SHADOW
    squares = np.einsum("ni,ni->n", rays, rays)
    for blob in blobs:
        along = _hit(origin, rays, squares, blob)
        nearer = np.flatnonzero(along < met)
        met[nearer] = along[nearer]
        normal = (origin + along[nearer][:, None] * rays[nearer] - blob.centre_m) / np.square(blob.radii_m)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        lit = 0.9 + 0.2 * normal @ (LAMP_M / np.linalg.norm(LAMP_M))
        colours[nearer] = lit[:, None] * blob.colour
        seen[nearer] = True
    height, width = camera.shape_px

    def pooled(plane: Floats) -> Floats:
        return np.asarray(plane.reshape(height, _SUB, width, _SUB, -1).mean(axis=(1, 3)))

    actor = pooled(seen.astype(np.float64))[..., 0] > 0.5
    shadow = (pooled((dark & ~seen).astype(np.float64))[..., 0] > 0.5) & ~actor
    return Rendered(pooled(colours), actor, shadow)


def noisy(colours: Floats, rng: np.random.Generator, noise: float = 1.5) -> Bytes:
    """What a camera makes of colours (H, W, 3): noise mostly common to the channels, rounding."""
    grain = rng.normal(0, noise, (*colours.shape[:2], 1)) + rng.normal(0, noise / 3, colours.shape)
    return np.clip(np.rint(colours + grain), 0, 255).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Moment:
    """What all cameras see at a moment."""

    views: list[Rendered]
    images: dict[int, Bytes]


def moment(cameras: Sequence[Camera], blobs: Sequence[Blob], seed: int, floor_m: float = 0.0) -> Moment:
    rng = np.random.default_rng(seed)
    views = [render(camera, blobs, floor_m) for camera in cameras]
    return Moment(views, {c: noisy(view.colours, rng) for c, view in enumerate(views)})


def plates(cameras: Sequence[Camera], floor_m: float = 0.0, n: int = 8) -> list[list[Bytes]]:
    """n pictures of the empty room per camera."""
    rng = np.random.default_rng(99)
    return [
        [noisy(colours, rng) for _ in range(n)]
        for colours in (render(camera, (), floor_m).colours for camera in cameras)
    ]


def joint_of(cameras: Sequence[Camera], pictures: Sequence[Sequence[Bytes]]) -> JointMatte:
    """A segmenter that knows pictures of the empty room per camera, and has learnt nothing yet."""
    known = [Plate.learn(frames, LIGHT_UNCERTAINTY) for frames in pictures]
    return JointMatte(cameras, known)


def joint(cameras: Sequence[Camera], floor_m: float = 0.0) -> JointMatte:
    """The same for the made-up room."""
    return joint_of(cameras, plates(cameras, floor_m))


def taught(segmenter: JointMatte, moments: Sequence[Mapping[int, Bytes]]) -> JointMatte:
    """The same segmenter once it has learnt from some moments."""
    segmenter.allow_for_errors(moments)
    segmenter.settle_floor(moments)
    for images in moments:
        segmenter.learn(images)
    segmenter.conclude()
    return segmenter


def iou(trimap: Trimap, true: Mask) -> float:
    """Of what is called actor with the true one; unsure pixels count for neither."""
    actor, sure = trimap == ACTOR, trimap != UNSURE
    return float((actor & true).sum() / max(((actor | true) & sure).sum(), 1))
