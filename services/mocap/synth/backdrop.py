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
    origin = camera.centre_world_m
    offsets = (np.arange(_RAYS) + 0.5) / _RAYS - 0.5
    x = (np.arange(camera.width_px)[:, None] + offsets).ravel()
    y = (np.arange(camera.height_px)[:, None] + offsets).ravel()
    directions = _rays_world(camera, x, y)
    hit, at_uv_m = _first_hits(origin, directions, patches)
    lattice = np.random.default_rng((seed, 2)).standard_normal((64, 64))
    bgr = np.zeros((len(hit), 3))
    for i, patch in enumerate(patches):
        rows = hit == i
        bgr[rows] = colour(patch, at_uv_m[rows], lattice, i)
    shape = (camera.height_px, _RAYS, camera.width_px, _RAYS)
    centre = _rays_world(camera, np.arange(float(camera.width_px)), np.arange(float(camera.height_px)))
    down = np.where(centre[:, 2] < -1e-3, -origin[2] / np.minimum(centre[:, 2], -1e-3), 1e3)
    floor_world_m = (origin + down[:, None] * centre)[:, :2].reshape(camera.height_px, camera.width_px, 2)
    return RoomView(
        picture=bgr.reshape(*shape, 3).mean(axis=(1, 3)).astype(np.float32),
        floor_share=(hit == 0).reshape(shape).mean(axis=(1, 3)).astype(np.float32),
        floor_world_m=floor_world_m.astype(np.float32),
    )


def _rays_world(camera: Camera, x_px: Floats, y_px: Floats) -> Floats:
    """(len(y) * len(x), 3) directions, row by row, through every pair of coordinates."""
    grid = np.stack([*np.meshgrid(x_px, y_px), np.ones((len(y_px), len(x_px)))], axis=-1).reshape(-1, 3)
    rays: Floats = grid @ np.linalg.inv(camera.K).T @ camera.R_camera_world
    return rays


def _first_hits(origin: Floats, directions: Floats, patches: tuple[Patch, ...]) -> tuple[Ints, Floats]:
    """The patch (N,) that each ray meets first, and where on it (N, 2), in metres along its edges."""
    nearness = np.zeros(len(directions))
    hit, at_uv_m = np.zeros(len(directions), np.int32), np.zeros((len(directions), 2))
    for i, patch in enumerate(patches):
        lengths_m = np.linalg.norm(patch.edges_world_m, axis=1)
        axes = patch.edges_world_m / lengths_m[:, None]
        normal = np.cross(axes[0], axes[1])
        from_corner = origin - patch.corner_world_m
        # The inverse of the distance, and u and v times it, are linear in the ray's direction.
        inverse = -normal / (from_corner @ normal)
        linear = np.stack(
            [
                inverse,
                axes[0] + (from_corner @ axes[0]) * inverse,
                axes[1] + (from_corner @ axes[1]) * inverse,
            ]
        )
        near, u, v = linear @ directions.T
        closer = (
            (near > nearness) & (u >= 0) & (v >= 0) & (u <= lengths_m[0] * near) & (v <= lengths_m[1] * near)
        )
        nearness[closer], hit[closer] = near[closer], i
        at_uv_m[closer] = np.stack([u[closer], v[closer]], axis=1) / near[closer, None]
    return hit, at_uv_m
