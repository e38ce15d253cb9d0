"""A compiled z-buffer for triangles, by the rule that the energy's rasterisers share."""

from dataclasses import dataclass

import numba
import numpy as np

from services.mocap.energy.snapping import NEAR_M, SUBPIXEL, project_snapped
from services.mocap.types import Floats, Ints, Mask, Singles

SAMPLES = 3
"""Samples per pixel and axis; being odd, one of them lies at the pixel's centre."""


@dataclass(frozen=True, eq=False)
class Layer:
    """A drawn body: the part of a picture that its bounding box covers."""

    x_px: int
    y_px: int
    bgr: Singles
    """(h, w, 3) mean colour of the samples, those beside the body counting as black."""
    coverage: Singles
    """(h, w) share of the samples that hit the body."""
    centre: Mask
    """(h, w) whether the pixel's centre is on the body."""


def draw(
    vertices_world_m: Floats, bgr: Singles, faces: Ints, P_px_world: Floats, size_px: tuple[int, int]
) -> Layer:
    """Draw a closed mesh with a colour per vertex.

    vertices_world_m (V, 3); bgr (V, 3); faces (F, 3), wound alike all over; P_px_world (3, 4); size_px: the
    picture's width and height.
    """
    uv, depth_m = project_snapped(vertices_world_m, P_px_world)
    low = np.clip(uv.min(axis=0) // SUBPIXEL, 0, size_px)
    high = np.clip(uv.max(axis=0) // SUBPIXEL + 2, low, size_px)
    width, height = (int(n) for n in high - low)
    # Sample k of a pixel lies at whole step SAMPLES * pixel + k; the pixel's centre is the middle sample.
    steps = SAMPLES * (uv.astype(np.int64) - low * SUBPIXEL) + (SAMPLES // 2) * SUBPIXEL
    samples: Singles = np.zeros((height * SAMPLES, width * SAMPLES, 3), np.float32)
    nearness = np.zeros(samples.shape[:2])
    _fill(steps, 1.0 / np.maximum(depth_m, NEAR_M), depth_m >= NEAR_M, faces, bgr, nearness, samples)
    hit = (nearness > 0).reshape(height, SAMPLES, width, SAMPLES)
    return Layer(
        x_px=int(low[0]),
        y_px=int(low[1]),
        bgr=samples.reshape(height, SAMPLES, width, SAMPLES, 3).mean(axis=(1, 3)),
        coverage=hit.mean(axis=(1, 3), dtype=np.float32),
        centre=hit[:, SAMPLES // 2, :, SAMPLES // 2].copy(),
    )


@numba.njit(cache=True, nogil=True)
def _fill(
    steps: Ints,
    nearness: Floats,
    in_front: Mask,
    faces: Ints,
    bgr: Singles,
    out_nearness: Floats,
    out_bgr: Singles,
) -> None:
    """Fill the faces that run counter-clockwise on the screen, the nearest on top, colours interpolated.

    The others are the far side of a closed mesh: they cover nothing that these do not.
    """
    height, width = out_nearness.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 2], faces[f, 1]  # clockwise, where y points down
        ax, ay, bx, by, cx, cy = steps[a, 0], steps[a, 1], steps[b, 0], steps[b, 1], steps[c, 0], steps[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area <= 0 or not (in_front[a] and in_front[b] and in_front[c]):
            continue
        x0, x1 = max(-(-min(ax, bx, cx) // SUBPIXEL), 0), min(max(ax, bx, cx) // SUBPIXEL + 1, width)
        y0, y1 = max(-(-min(ay, by, cy) // SUBPIXEL), 0), min(max(ay, by, cy) // SUBPIXEL + 1, height)
        # A sample on an edge belongs to the triangle where the edge is a top or a left one.
        edge_a = 0 if (cy == by and cx > bx) or cy < by else 1
        edge_b = 0 if (ay == cy and ax > cx) or ay < cy else 1
        edge_c = 0 if (by == ay and bx > ax) or by < ay else 1
        for row in range(y0, y1):
            y = row * SUBPIXEL
            for column in range(x0, x1):
                x = column * SUBPIXEL
                wa = (cx - bx) * (y - by) - (cy - by) * (x - bx)
                wb = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
                wc = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
                if wa < edge_a or wb < edge_b or wc < edge_c:
                    continue
                near = (wa * nearness[a] + wb * nearness[b] + wc * nearness[c]) / area
                if near > out_nearness[row, column]:
                    out_nearness[row, column] = near
                    for k in range(3):
                        out_bgr[row, column, k] = (wa * bgr[a, k] + wb * bgr[b, k] + wc * bgr[c, k]) / area
