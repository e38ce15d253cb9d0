"""What a camera sees of the empty room: every pixel casts rays onto the room's patches."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from services.mocap.camera.camera import Camera
from services.mocap.synth.room import Patch, colour
from services.mocap.types import Floats, Ints

Singles: TypeAlias = NDArray[np.float32]
"""Pictures (H, W, 3), BGR in grey levels before a camera's noise and rounding, and shares (H, W)."""

_RAYS = 2  # per pixel and axis, so that edges are soft


@dataclass(frozen=True, eq=False)
class RoomView:
    """What one camera sees of the empty room."""

    picture: Singles
    floor_share: Singles
    """(H, W) how much of each pixel is floor, 0 to 1."""
    floor_world_m: Singles
    """(H, W, 2) x and y of the floor at each pixel's centre; far away where the pixel sees no floor."""


def view_room(camera: Camera, patches: tuple[Patch, ...], seed: int) -> RoomView:
    """Cast a camera's rays onto the patches, the first of which is the floor."""
    offsets = (np.arange(_RAYS) + 0.5) / _RAYS - 0.5
    x_px = (np.arange(camera.width_px)[:, None] + offsets).ravel()
    y_px = (np.arange(camera.height_px)[:, None] + offsets).ravel()
    hit, at_uv_m = _first_hits(camera, patches, x_px, y_px)
    lattice = np.random.default_rng((seed, 2)).standard_normal((64, 64))
    bgr = np.zeros((*hit.shape, 3))
    for i, patch in enumerate(patches):
        rows = hit == i
        bgr[rows] = colour(patch, at_uv_m[rows], lattice, i)
    shape = (camera.height_px, _RAYS, camera.width_px, _RAYS)
    return RoomView(
        picture=bgr.reshape(*shape, 3).mean(axis=(1, 3)).astype(np.float32),
        floor_share=(hit == 0).reshape(shape).mean(axis=(1, 3)).astype(np.float32),
        floor_world_m=_floor_world_m(camera, patches[0]),
    )


def _first_hits(
    camera: Camera, patches: tuple[Patch, ...], x_px: Floats, y_px: Floats
) -> tuple[Ints, Floats]:
    """The patch (Y, X) that each pair of coordinates sees, and where on it (Y, X, 2), in metres."""
    nearness = np.zeros((len(y_px), len(x_px)))
    hit, at_uv_m = np.zeros(nearness.shape, np.int32), np.zeros((*nearness.shape, 2))
    for i, patch in enumerate(patches):
        near, u, v = _on_plane(camera, patch, x_px, y_px)
        length_u_m, length_v_m = np.linalg.norm(patch.edges_world_m, axis=1)
        closer = (near > nearness) & (u >= 0) & (v >= 0) & (u <= length_u_m * near) & (v <= length_v_m * near)
        nearness[closer], hit[closer] = near[closer], i
        at_uv_m[closer] = np.stack([u[closer], v[closer]], axis=1) / near[closer, None]
    return hit, at_uv_m


def _on_plane(camera: Camera, patch: Patch, x_px: Floats, y_px: Floats) -> Floats:
    """Where rays meet a patch's plane: (3, Y, X), one over their depth, u and v in metres over their depth.

    All three are linear in the pixel; the first one is negative where the plane lies behind the camera.
    """
    axes = patch.edges_world_m / np.linalg.norm(patch.edges_world_m, axis=1, keepdims=True)
    normal = np.cross(axes[0], axes[1])
    from_corner_m = camera.centre_world_m - patch.corner_world_m
    inverse = -normal / (from_corner_m @ normal)
    u, v = axes + np.outer(axes @ from_corner_m, inverse)
    by_x, by_y, constant = (np.stack([inverse, u, v]) @ camera.R_camera_world.T @ np.linalg.inv(camera.K)).T
    rows: Floats = by_y[:, None] * y_px + constant[:, None]
    near_u_v: Floats = by_x[:, None, None] * x_px + rows[:, :, None]
    return near_u_v


def _floor_world_m(camera: Camera, floor: Patch) -> Singles:
    """(H, W, 2) x and y of the floor at each pixel's centre, 1 km away from the middle above the horizon."""
    x_px, y_px = np.arange(float(camera.width_px)), np.arange(float(camera.height_px))
    near, u, v = _on_plane(camera, floor, x_px, y_px)
    seen = near > 1e-3
    at_m = np.stack([u, v], axis=-1) / np.where(seen, near, 1.0)[..., None] + floor.corner_world_m[:2]
    return np.where(seen[..., None], at_m, 1e3).astype(np.float32)
