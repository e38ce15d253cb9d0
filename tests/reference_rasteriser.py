"""The slow, obvious rasteriser that every backend is held against.

The shared rule: vertices are snapped to 1/256 pixel; a pixel is covered when its centre lies in any
triangle that faces the camera; a centre on an edge belongs to the triangle if the edge is a top or a left
one; a triangle with a vertex nearer than the near plane is not drawn.
"""

import numpy as np

from services.mocap.energy.snapping import NEAR_M, SUBPIXEL, project_snapped
from services.mocap.types import Floats, Ints, Mask


def rasterise(
    vertices_world_m: Floats, faces: Ints, P_px_world: Floats, width_px: int, height_px: int
) -> Mask:
    """The mask (H, W) of the pixels that triangles cover.

    vertices_world_m: (V, 3). faces: (F, 3). P_px_world: (3, 4), one camera.
    """
    uv, depth_m = project_snapped(vertices_world_m, P_px_world)
    mask: Mask = np.zeros((height_px, width_px), bool)
    for face in faces:
        if np.all(depth_m[face] >= NEAR_M):
            _fill(uv[face].astype(np.int64), mask)
    return mask


def _fill(corners: Ints, mask: Mask) -> None:
    """Set the pixels whose centres lie in one triangle, corners (3, 2) in 1/256 pixel."""
    height, width = mask.shape
    a, c, b = corners  # counter-clockwise on the screen, where y points down, turned to clockwise
    (abx, aby), (acx, acy) = (b - a).tolist(), (c - a).tolist()
    if abx * acy - aby * acx <= 0:
        return
    x0, y0 = np.maximum(-(-corners.min(axis=0) // SUBPIXEL), 0)
    x1, y1 = np.minimum(corners.max(axis=0) // SUBPIXEL + 1, (width, height))
    if x0 >= x1 or y0 >= y1:
        return
    y, x = np.mgrid[y0:y1, x0:x1] * SUBPIXEL
    inside = np.ones(x.shape, bool)
    for start, end in ((a, b), (b, c), (c, a)):
        dx, dy = end - start
        area = dx * (y - start[1]) - dy * (x - start[0])
        top_or_left = (dy == 0 and dx > 0) or dy < 0
        inside &= area >= 0 if top_or_left else area > 0
    mask[y0:y1, x0:x1] |= inside
