"""The turntable picture: a body from eight sides in front of a grid of decimetres, for measuring."""

import cv2
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, SEGMENT_NAMES, SIDES
from services.mocap.export.tiles import CENTRE_BGR, LEFT_BGR, RIGHT_BGR
from services.mocap.synth.raster import draw
from services.mocap.synth.render import Model
from services.mocap.types import Bytes, Floats, Ints, Singles

N_VIEWS = 8
_COLUMNS = 4
_PX_PER_M = 300
_MARGIN_M = 0.12
"""Over the head and under the floor."""
_ARMS_DOWN_RAD, _LEGS_APART_RAD = 0.95, 0.09
"""The pose: arms and legs off the trunk, so that every outline shows."""
_DISTANCE_M = 200.0
"""Distance of the camera, so large that near and far parts of a body have the same scale within 0.2 %."""
_NAMES = ("front", "front left", "left", "back left", "back", "back right", "right", "front right")

_PAPER_BGR, _TENTHS_BGR, _HALVES_BGR, _INK_BGR = (250,) * 3, (228,) * 3, (185,) * 3, (70,) * 3
_SKIN = np.array((190.0, 195.0, 200.0))
_TINTS = {"left": LEFT_BGR, "right": RIGHT_BGR}
_TINT = 0.35
"""Share of the sides' colours, those of the overlay, in the body's."""
_LIGHT = np.array((0.45, 0.35, 0.82))  # towards it, in the body's frame of the front view
_AMBIENT, _DIFFUSE = 0.42, 0.62


def draw_turntable(body: Body) -> Bytes:
    """The picture (H, W, 3) of a body standing with its arms held away, 300 pixels to the metre.

    The views run from the front counter-clockwise as seen from above. All are in one scale; lines are 10 cm
    apart, the strong ones half a metre, counted up from the floor and sideways from the hips' middle.
    """
    pose = np.zeros(N_DOF)
    for side in SIDES:
        pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = -_ARMS_DOWN_RAD
        pose[DOF_INDEX[f"{side}_hip_abduction"]] = _LEGS_APART_RAD
    pose[DOF_INDEX["root_z"]] = -body.lowest_point_m(pose)
    model = Model(body)
    vertices_m, normals = model.posed(pose)
    names = [*SEGMENT_NAMES, *["skirt"] * len(body.cloth_m)]
    tints = np.array([_TINTS.get(name.partition("_")[0], CENTRE_BGR) for name in names])
    bgr = ((1.0 - _TINT) * _SKIN + _TINT * tints).repeat([len(v) for v, _ in body.surfaces], axis=0)
    reach_m = float(np.linalg.norm(vertices_m[:, :2], axis=1).max()) + _MARGIN_M / 2
    tiles = [_view(vertices_m, normals, bgr, model.faces, view, reach_m) for view in range(N_VIEWS)]
    rows = [np.hstack(tiles[i : i + _COLUMNS]) for i in range(0, N_VIEWS, _COLUMNS)]
    return np.vstack(rows)


def _view(vertices_m: Floats, normals: Floats, bgr: Floats, faces: Ints, view: int, reach_m: float) -> Bytes:
    """One tile: the grid, and in front of it the body, rotated to the view's side."""
    angle = -2.0 * np.pi * view / N_VIEWS
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    light = _LIGHT / np.linalg.norm(_LIGHT)
    shade = _AMBIENT + _DIFFUSE * np.maximum(normals @ R.T @ light, 0.0)
    shaded: Singles = np.minimum(bgr * shade[:, None], 255.0).astype(np.float32)
    top_m = float(vertices_m[:, 2].max()) + _MARGIN_M
    size_px = (round(2 * reach_m * _PX_PER_M), round((top_m + _MARGIN_M) * _PX_PER_M))
    tile = _grid(size_px, reach_m, top_m)
    layer = draw(vertices_m @ R.T, shaded, faces, _projection(reach_m, top_m), size_px)
    height, width = layer.coverage.shape
    window = tile[layer.y_px : layer.y_px + height, layer.x_px : layer.x_px + width]
    window[:] = np.rint(window * (1.0 - layer.coverage[..., None]) + layer.bgr).astype(np.uint8)
    _write(tile, _NAMES[view], (8, 20))
    return tile


def _projection(reach_m: float, top_m: float) -> Floats:
    """(3, 4) from metres to pixels of a camera far out on the x axis; y, to the left, runs to the right."""
    focal_px = _PX_PER_M * _DISTANCE_M
    K = np.array([[focal_px, 0.0, reach_m * _PX_PER_M], [0.0, focal_px, top_m * _PX_PER_M], [0.0, 0.0, 1.0]])
    camera = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, _DISTANCE_M]])
    projection: Floats = K @ camera
    return projection


def _grid(size_px: tuple[int, int], reach_m: float, top_m: float) -> Bytes:
    """Paper with lines every 10 cm from the floor up, and to both sides of the middle."""
    width_px, height_px = size_px
    paper: Bytes = np.full((height_px, width_px, 3), _PAPER_BGR, np.uint8)
    sideways = round(reach_m / 0.1)
    ups = range(-round(_MARGIN_M / 0.1), round(top_m / 0.1) + 1)
    for tenths in sorted(range(-sideways, sideways + 1), key=_is_half):  # the strong ones over the others
        x = round((reach_m + 0.1 * tenths) * _PX_PER_M)
        cv2.line(paper, (x, 0), (x, height_px), _HALVES_BGR if _is_half(tenths) else _TENTHS_BGR, 1)
    for tenths in sorted(ups, key=_is_half):
        y = round((top_m - 0.1 * tenths) * _PX_PER_M)
        cv2.line(paper, (0, y), (width_px, y), _HALVES_BGR if _is_half(tenths) else _TENTHS_BGR, 1)
        if _is_half(tenths):
            _write(paper, f"{tenths / 10:.1f} m", (4, y - 4))
    cv2.rectangle(paper, (0, 0), (width_px - 1, height_px - 1), _HALVES_BGR, 1)
    return paper


def _is_half(tenths: int) -> bool:
    return tenths % 5 == 0


def _write(picture: Bytes, text: str, origin_px: tuple[int, int]) -> None:
    cv2.putText(picture, text, origin_px, cv2.FONT_HERSHEY_SIMPLEX, 0.42, _INK_BGR, 1, cv2.LINE_AA)
