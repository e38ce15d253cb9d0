"""The input's contours: points between pixels, each with the direction that leads off the actor."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.types import Bytes, Floats, Ints, Mask

WORKING_WIDTH_PX = 320
"""Lengths on pictures are measured in pixels of pictures of this width, whatever the cameras' is."""
BORDER_PX = 2.0
"""This near to a picture's border, in pixels of the camera, an outline may be the picture's end."""
_NORMAL_REACH_PX = 1.5
"""Silhouettes are blurred by this standard deviation to see which way their outline faces."""
_TURN_PX = 12.0
"""Two outline points that face the same way count as this much nearer than two at right angles, over √2."""


@dataclass(frozen=True, eq=False)
class Contour:
    """One camera's outline of the actor in one frame."""

    points_px: Floats
    """(N, 2) half-way between a pixel centre on the actor and its neighbour off it."""
    normals: Floats
    """(N, 2) unit vectors that point off the actor."""
    chosen: Ints
    """Indices of the points that are looked for on the model, evenly spread."""
    tree: cKDTree
    """All points as features (N, 4)."""
    length_px: float
    """Length of the outline in working pixels."""

    @classmethod
    def of(cls, silhouette: Mask, scale: float, n_chosen: int) -> "Contour":
        """The outline of a picture (H, W), which has `scale` pixels per working pixel."""
        points_px = _between_pixels(silhouette)
        normals = _normals(silhouette, points_px)
        steps = np.linspace(0, max(len(points_px) - 1, 0), min(n_chosen, len(points_px)))
        chosen = np.rint(steps).astype(np.int32)
        features = features_of(points_px, normals, scale)
        # Slanted lines run between neighbours of both kinds: on the whole 4 / π times per pixel of length.
        return cls(points_px, normals, chosen, cKDTree(features), len(points_px) * np.pi / 4 / scale)


def features_of(points_px: Floats, normals: Floats, scale: float) -> Floats:
    """What outline points (N, 2) are matched by: features (N, 4), their distances in working pixels."""
    return np.hstack([points_px / scale, _TURN_PX * normals])


def working_scales(rig: Rig) -> Floats:
    """(C,) pixels of a camera per working pixel."""
    scales: Floats = rig.sizes_px[:, 0] / WORKING_WIDTH_PX
    return scales


def contours_of(rig: Rig, silhouettes: Bytes, n_chosen: int) -> list[list[Contour]]:
    """Per frame and camera the contour of silhouettes (F, P, H, W)."""
    scales = working_scales(rig)
    return [
        [
            Contour.of(mask[: rig.sizes_px[c, 1], : rig.sizes_px[c, 0]], float(scales[c]), n_chosen)
            for c, mask in enumerate(unpack(planes, rig.n_cameras))
        ]
        for planes in silhouettes
    ]


def off_border(points_px: Floats, size_px: Ints) -> Mask:
    """Which points (N, 2) lie well within a picture of a width and height (2,)."""
    inside: Mask = np.all((points_px >= BORDER_PX) & (points_px <= size_px - 1 - BORDER_PX), axis=1)
    return inside


def _between_pixels(silhouette: Mask) -> Floats:
    """(N, 2) midpoints of neighbours of which one is on the actor, away from the picture's border."""
    y, x = np.nonzero(silhouette[:, 1:] != silhouette[:, :-1])
    beside = np.column_stack([x + 0.5, y])
    y, x = np.nonzero(silhouette[1:] != silhouette[:-1])
    points_px = np.vstack([beside, np.column_stack([x, y + 0.5])]).astype(np.float64)
    height, width = silhouette.shape
    return points_px[off_border(points_px, np.array([width, height], np.int32))]


def _normals(silhouette: Mask, points_px: Floats) -> Floats:
    blurred = cv2.GaussianBlur(silhouette.astype(np.float32), (0, 0), _NORMAL_REACH_PX)
    slopes = [cv2.Sobel(blurred, cv2.CV_32F, *order, ksize=3) for order in ((1, 0), (0, 1))]
    low, high = np.floor(points_px).astype(np.int64), np.ceil(points_px).astype(np.int64)
    normals = -np.stack([slope[low[:, 1], low[:, 0]] + slope[high[:, 1], high[:, 0]] for slope in slopes], 1)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: Floats = (normals / np.maximum(lengths, 1e-9)).astype(np.float64)
    return unit
