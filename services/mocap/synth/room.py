"""The studio's room: a tiled floor, plastered walls, posters and crates, and what a camera sees of it.

All of it are flat textured patches, whose sizes, places and colours come from a seed: one seed is one room.
Every pixel of a camera casts rays onto the patches.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from services.mocap.camera.camera import Camera
from services.mocap.types import Floats, Ints, Singles

LIGHT_WORLD: Floats = np.array([0.42, 0.28, 0.863]) / np.linalg.norm([0.42, 0.28, 0.863])
"""Unit vector towards the main light, 60 degrees over the horizon."""

_HALF_X_M, _HALF_Y_M, _WALL_M = 5.6, 5.2, 9.0  # the cameras stand up to 4.4 m from the middle

_RAYS = 2  # per pixel and axis, so that edges are soft


@dataclass(frozen=True, eq=False)
class Patch:
    """A textured rectangle."""

    corner_world_m: Floats
    """(3,)"""
    edges_world_m: Floats
    """(2, 3) the sides that begin at the corner, at right angles to each other."""
    bgr: Floats
    """(3,) mean colour in grey levels, under full light."""
    noise: float
    """Contrast of the texture, as a share of the colour."""
    tile_m: float | None = None
    """Side of square tiles, where it has any."""


def room_patches(seed: int, size: float = 1.0) -> tuple[Patch, ...]:
    """The patches of one room; the floor is the first one, each side as long as usual times size."""
    rng = np.random.default_rng((seed, 1))
    tint = rng.uniform(0.94, 1.06, 3)
    x, y = size * _HALF_X_M, size * _HALF_Y_M
    floor = Patch(
        np.array([-x, -y, 0.0]), np.array([[2 * x, 0, 0], [0, 2 * y, 0]]), tint * (132, 142, 150), 0.13, 0.5
    )
    wall_bgr = rng.uniform(0.94, 1.06, 3) * (172, 166, 160)
    corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
    patches = [floor]
    for i in range(4):
        along = corners[(i + 1) % 4] - corners[i]
        walls = Patch(
            corners[i], np.stack([along, [0.0, 0.0, _WALL_M]]), wall_bgr * rng.uniform(0.82, 1.0), 0.10, 1.3
        )
        patches += [walls, *_posters(walls, rng)]
        patches += _crate(0.86 * corners[i] + 0.1 * rng.uniform(0.2, 1.0) * along, rng)
    return tuple(patches)


def _posters(wall: Patch, rng: np.random.Generator) -> list[Patch]:
    """A skirting board and two framed posters, just in front of a wall."""
    along = wall.edges_world_m[0]
    length_m = float(np.linalg.norm(along))
    right = along / length_m
    inward = np.array([-right[1], right[0], 0.0])
    skirting = Patch(
        wall.corner_world_m + 0.02 * inward,
        np.stack([along, [0.0, 0.0, 0.12]]),
        np.array([88.0, 86, 84]),
        0.05,
    )
    patches = [skirting]
    for place in (0.3, 0.7):
        size_m = rng.uniform((0.8, 0.6), (1.5, 1.1))
        start_m = (place + rng.uniform(-0.1, 0.1)) * length_m - size_m[0] / 2
        corner = wall.corner_world_m + start_m * right + [0.0, 0.0, rng.uniform(0.8, 1.5)]
        bgr = rng.uniform(50, 200, 3)
        for border_m, colour, tile_m in ((0.0, np.array([60.0, 64, 70]), None), (0.05, bgr, 0.3)):
            edges = np.stack([(size_m[0] - 2 * border_m) * right, [0.0, 0.0, size_m[1] - 2 * border_m]])
            inset = border_m * np.array([right[0], right[1], 1.0]) + (0.02 + 0.2 * border_m) * inward
            patches.append(Patch(corner + inset, edges, colour, 0.25, tile_m))
    return patches


def _crate(centre_world_m: Floats, rng: np.random.Generator) -> list[Patch]:
    """The five visible sides of a crate that stands on the floor."""
    size = rng.uniform((0.45, 0.4, 0.5), (0.8, 0.7, 1.3))
    low = centre_world_m - [size[0] / 2, size[1] / 2, 0.0]
    ex, ey, ez = np.diag(size)
    bgr = rng.uniform(70, 190, 3)
    sides = ((low, ex, ez), (low + ey, ex, ez), (low, ey, ez), (low + ex, ey, ez), (low + ez, ex, ey))
    return [Patch(corner, np.stack([u, v]), bgr, 0.15) for corner, u, v in sides]


def colour(patch: Patch, uv_m: Floats, lattice: Floats, number: int) -> Floats:
    """BGR (N, 3) in grey levels of points (N, 2) on a patch, in metres along its edges: texture times light.

    lattice: (64, 64) random numbers to make textures of. number: the patch's, so that no two look alike.
    """
    texture = 1.0 + patch.noise * _smooth_noise(uv_m + 3.7 * number, lattice)
    if patch.tile_m is not None:
        tile = np.floor(uv_m / patch.tile_m).astype(int)
        texture += 0.4 * patch.noise * lattice[tile[:, 0] % 64, tile[:, 1] % 64]
        from_edge_m = np.abs(uv_m - patch.tile_m * np.round(uv_m / patch.tile_m)).min(axis=1)
        texture *= np.where(from_edge_m < 0.008, 0.82, 1.0)
    points_world_m = patch.corner_world_m + uv_m @ (
        patch.edges_world_m / np.linalg.norm(patch.edges_world_m, axis=1)[:, None]
    )
    return patch.bgr * (texture * _light(patch, points_world_m))[:, None]


def _smooth_noise(uv_m: Floats, lattice: Floats) -> Floats:
    """(N,) about -1 to 1: cloudy at a metre, grainy at some centimetres."""
    octaves = ((1.1, 0.45), (4.3, 0.3), (17.0, 0.3))
    return sum(
        (
            share * map_coordinates(lattice, uv_m.T * per_m, order=1, mode="grid-wrap")
            for per_m, share in octaves
        ),
        start=np.zeros(len(uv_m)),
    )


def _light(patch: Patch, points_world_m: Floats) -> Floats:
    """(N,) light at points of a patch: brighter where it faces the lamp and near the middle of the room."""
    normal = np.cross(*patch.edges_world_m)
    inward = np.sign(-patch.corner_world_m @ normal) or 1.0
    facing = float(normal / np.linalg.norm(normal) @ LIGHT_WORLD) * inward
    away2 = ((points_world_m - 2.5 * LIGHT_WORLD) ** 2).sum(axis=1)
    light: Floats = (0.78 + 0.14 * facing) * (0.72 + 0.4 * np.exp(-away2 / 32.0))
    return light


@dataclass(frozen=True, eq=False)
class RoomView:
    """What one camera sees of the empty room."""

    picture: Singles
    """(H, W, 3) BGR in grey levels, before a camera's noise and rounding."""
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
