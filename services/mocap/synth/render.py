"""Pictures of a clothed body in the studio: shading, cast shadow, anti-aliased edges, a camera's noise."""

from dataclasses import dataclass

import cv2
import numpy as np
import trimesh

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_RIGID, surface_transforms
from services.mocap.body.skeleton import SEGMENT_INDEX, SEGMENTS
from services.mocap.body.surface import as_one
from services.mocap.camera.camera import Camera
from services.mocap.synth.raster import draw
from services.mocap.synth.room import LIGHT_WORLD, RoomView
from services.mocap.types import Bytes, Floats, Ints, Mask, Singles

SHADOW = 0.6
"""What is left of the floor's brightness in the full shadow."""
NOISE = 2.4
"""Standard deviation of a camera's noise, in grey levels."""
FLICKER = 0.005
"""Standard deviation of a camera's gain from frame to frame."""

_FLOOR_HALF_M, _FLOOR_CELL_M, _PENUMBRA_M = 3.2, 0.016, 0.03
_FLAT = 1e-12
"""A normal shorter than this has no direction."""
_AMBIENT, _DIFFUSE, _SKY = 0.42, 0.62, 0.10

_SKIN = (138.0, 168.0, 214.0)
_SHIRT = (52.0, 96.0, 206.0)
_TROUSERS = (122.0, 74.0, 46.0)
_SHOES = (44.0, 46.0, 52.0)
_HAIR = (34.0, 48.0, 66.0)
_BELT = (30.0, 34.0, 40.0)

_PLAIN = {"shirt": _SHIRT, "skin": _SKIN, "trousers": _TROUSERS, "shoes": _SHOES}


@dataclass(frozen=True, eq=False)
class Figure:
    """The body in one pose, lit: the same for all cameras."""

    vertices_world_m: Floats
    """(V, 3)"""
    bgr: Singles
    """(V, 3) colours in grey levels, shaded."""
    faces: Ints
    """(F, 3)"""
    shadow: Singles
    """(n, n) how much of the main light is missing on a square of floor, 0 to 1; see floor_cells."""


class Model:
    """A body with clothes on, ready to be posed and lit."""

    def __init__(self, body: Body) -> None:
        """Find colours and normals in the rest pose, once."""
        self._body = body
        self._normals = [trimesh.Trimesh(v, f, process=False).vertex_normals for v, f in body.surfaces]
        self._albedo_bgr = _dressed(body)
        self.faces: Ints = as_one(body.surfaces)[1]
        """(F, 3)"""

    def posed(self, pose: Floats) -> tuple[Floats, Floats]:
        """Vertices in the world, in metres, and their normals, (V, 3) each, in a (D,) pose."""
        T_world_surface = surface_transforms(pose[None], self._body.offsets_m)[0]
        normals = np.concatenate(
            [
                _turned(n, T[:3, :3]) if s >= N_RIGID else n @ T[:3, :3].T
                for s, (n, T) in enumerate(zip(self._normals, T_world_surface, strict=True))
            ]
        )
        return self._body.posed_m(pose), normals

    def pose(self, pose: Floats) -> Figure:
        """The figure in a (D,) pose."""
        vertices_world_m, normals = self.posed(pose)
        light = _AMBIENT + _DIFFUSE * np.maximum(normals @ LIGHT_WORLD, 0.0) + _SKY * normals[:, 2]
        bgr = (self._albedo_bgr * light[:, None]).astype(np.float32)
        return Figure(vertices_world_m, bgr, self.faces, _cast_shadow(vertices_world_m, bgr, self.faces))


def _turned(normals: Floats, A: Floats) -> Floats:
    """Unit normals (V, 3) of a mesh that a matrix (3, 3) stretches; flat ones stay without a direction."""
    a, b, c = A.T
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    turned = normals @ cofactors.T * np.sign(np.linalg.det(A))
    return np.asarray(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), _FLAT))


def _dressed(body: Body) -> Floats:
    """BGR (V, 3) in grey levels under full light, for the vertices of all surfaces one after the other."""
    rng = np.random.default_rng(7)  # the weave of the cloth; the same in every take
    colours = []
    rows, cloth = [segment.row for segment in SEGMENTS], SEGMENTS[SEGMENT_INDEX["pelvis"]].row
    rows += [cloth] * len(body.cloth_m)
    for s, (row, (vertices_m, _)) in enumerate(zip(rows, body.surfaces, strict=True)):
        kind = row.name if s < N_RIGID else "web"
        bgr = np.tile(_PLAIN[row.garment], (len(vertices_m), 1))
        x, y, z = vertices_m.T / body.height_m
        if kind == "upper_arm":
            bgr[np.abs(y) > 0.095] = _SKIN  # short sleeves
        elif kind == "pelvis":
            bgr[z > 0.042] = _BELT
            bgr[z > 0.058] = _SHIRT
        elif kind == "head":
            bgr[(z > 0.072) | (z - 0.9 * x > 0.052)] = _HAIR
        colours.append(bgr * rng.normal(1.0, 0.025, (len(bgr), 1)))
    return np.concatenate(colours)


def _cast_shadow(vertices_world_m: Floats, bgr: Singles, faces: Ints) -> Singles:
    """The body seen along the main light, drawn onto the floor, with a soft edge."""
    n = round(2 * _FLOOR_HALF_M / _FLOOR_CELL_M)
    slant = LIGHT_WORLD[:2] / LIGHT_WORLD[2]
    P_cell_world = np.zeros((3, 4))
    P_cell_world[:2, :2] = np.eye(2) / _FLOOR_CELL_M
    P_cell_world[:2, 2] = -slant / _FLOOR_CELL_M
    P_cell_world[:2, 3] = floor_cells(np.zeros(2, np.float32))
    P_cell_world[2, 3] = 1.0
    layer = draw(vertices_world_m, bgr, faces, P_cell_world, (n, n))
    shadow: Singles = np.zeros((n, n), np.float32)
    height, width = layer.coverage.shape
    shadow[layer.y_px : layer.y_px + height, layer.x_px : layer.x_px + width] = layer.coverage
    return cv2.GaussianBlur(shadow, (0, 0), _PENUMBRA_M / _FLOOR_CELL_M).astype(np.float32, copy=False)


def floor_cells(floor_world_m: Singles) -> Singles:
    """Column and row (…, 2) in a figure's shadow of floor points (…, 2)."""
    return (floor_world_m + np.float32(_FLOOR_HALF_M)) / np.float32(_FLOOR_CELL_M) - np.float32(0.5)


def shadowed(view: RoomView, figure: Figure) -> Singles:
    """The room with the figure's shadow on its floor, but without the figure."""
    cells = floor_cells(view.floor_world_m)
    missing = cv2.remap(figure.shadow, cells[..., 0], cells[..., 1], cv2.INTER_LINEAR)
    left = 1.0 - np.float32(1.0 - SHADOW) * missing * view.floor_share
    return view.picture * left[..., None]


def render(camera: Camera, view: RoomView, figure: Figure) -> tuple[Singles, Mask]:
    """The noise-free picture (H, W, 3) and the silhouette (H, W): the pixels whose centres are on the body.

    An edge pixel's colour is mixed from body and room, so that a few pixels beside the silhouette show some
    body too.
    """
    picture = shadowed(view, figure)
    layer = draw(figure.vertices_world_m, figure.bgr, figure.faces, camera.P_px_world, camera.size_px)
    height, width = layer.coverage.shape
    window = np.s_[layer.y_px : layer.y_px + height, layer.x_px : layer.x_px + width]
    picture[window] = picture[window] * (1.0 - layer.coverage[..., None]) + layer.bgr
    silhouette: Mask = np.zeros(picture.shape[:2], bool)
    silhouette[window] = layer.centre
    return picture, silhouette


def expose(picture: Singles, rng: np.random.Generator) -> Bytes:
    """What a camera delivers of a picture: gain flicker, noise, whole grey levels."""
    gain = np.float32(1.0 + FLICKER * rng.standard_normal())
    noise = rng.standard_normal(picture.shape, dtype=np.float32)
    noise *= np.float32(NOISE)
    noise += gain * picture
    return np.clip(np.rint(noise), 0, 255).astype(np.uint8)
