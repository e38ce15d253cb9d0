"""Objects that were put onto the stage, or taken off it, after the clean plates were recorded.

A chair that was moved differs from the plates in all cameras, as the actor does. But it stays where it is
while somebody else moves. A group of voxels that shows a change at nearly all moments is an object if

- two cameras see most of it beside the other such groups: where the rays to several things meet, there may be
  nothing;
- at most of these moments the changed voxels some way off still hold somebody who moves, stands on the floor,
  and is as tall as a person: around somebody who hardly moves there are only arms, and a leg.
"""

from collections import deque
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from scipy import ndimage

from services.mocap.types import Mask
from services.segmentation.voxels import COARSE_M, VoxelGrid

_MOMENTS = 24
"""So many moments count: the last ones."""
_FEWEST_MOMENTS, _STATIC = 6, 0.9
"""From so many moments on: voxels that show a change in at least this share of them are static."""
_PERSON_M, _PERSON_VOXELS, _ON_FLOOR_M = 1.0, 30, 0.4
"""Somebody is at least so tall, and begins at most so far above the floor."""
_MOVING_SHARE = 0.1
"""Of the voxels of somebody who moves, at least this share is not static."""
_ACCOMPANIED = 0.7
"""Somebody who moves must be there beside an object in at least this share of the moments."""
_APART_VOXELS = 3
"""How far off that is: a third of a metre. Drawn crates have somebody there at all moments, people who stand
still (four takes) at 7 % of them at most."""
_LEAST_VOXELS = 8
"""Size of the smallest object: about 25 cm each way."""
_BESIDE, _CAMERAS_BESIDE = 0.5, 2
"""Share of an object's picture that must lie beside the others, in so many cameras."""
_NEIGHBOURS = np.ones((3, 3, 3), bool)


class StaticObjects:
    """Collects which voxels have changed at some moments, and finds the objects among them."""

    def __init__(self, voxels: VoxelGrid) -> None:
        self._voxels = voxels
        place = np.rint((voxels.coarse_m - voxels.coarse_m.min(axis=0)) / COARSE_M).astype(int)
        self._place = tuple(place.T)
        self._shape = tuple(place.max(axis=0) + 1)
        self._moments: deque[Mask] = deque(maxlen=_MOMENTS)

    def add(self, changed: Mapping[int, Mask]) -> None:
        """Add a moment: by camera which pixels (H, W) have surely changed."""
        n_seen, n_changed = np.zeros((2, len(self._voxels.coarse_m)), np.int32)
        for c, mask in changed.items():
            size_px = int(self._voxels.reach_px[c])
            near = cv2.dilate(mask.view(np.uint8), np.ones((size_px, size_px), np.uint8))
            x, y = self._voxels.coarse_px[c].T
            is_seen = x >= 0
            n_seen += is_seen
            n_changed += is_seen & (near[np.maximum(y, 0), np.maximum(x, 0)] > 0)
        self._moments.append((n_seen >= 2) & (n_changed == n_seen))

    def masks(self, shapes_px: Sequence[tuple[int, int]]) -> list[Mask]:
        """Where each camera, with pictures of some shape (H, W), may see an object."""
        objects = self._objects(shapes_px)
        return [self._drawn(objects, c, shape, 2) for c, shape in enumerate(shapes_px)]

    def _drawn(self, voxels: Mask, camera: int, shape_px: tuple[int, int], size: int) -> Mask:
        """Voxels (N,) as squares of so many times their size in a camera's picture (H, W)."""
        drawn = np.zeros(shape_px, np.uint8)
        x, y = self._voxels.coarse_px[camera][voxels].T
        drawn[y[x >= 0], x[x >= 0]] = 1
        square = np.ones((size * int(self._voxels.reach_px[camera]),) * 2, np.uint8)
        # Close to the camera voxels are larger: closing fills the gaps between their squares.
        return np.asarray(cv2.morphologyEx(cv2.dilate(drawn, square), cv2.MORPH_CLOSE, square) > 0)

    def _objects(self, shapes_px: Sequence[tuple[int, int]]) -> Mask:
        """(N,) the voxels of objects."""
        found = np.zeros(len(self._voxels.coarse_m), bool)
        if len(self._moments) < _FEWEST_MOMENTS:
            return found
        share = np.mean(self._moments, axis=0)
        is_static = share >= _STATIC
        static = self._filled(is_static)
        labels, n_groups = ndimage.label(static, _NEIGHBOURS)
        moments = [self._filled(moment) for moment in self._moments]
        for label in range(1, n_groups + 1):
            is_group = labels == label
            group = is_group[self._place]
            if np.count_nonzero(group) < _LEAST_VOXELS:
                continue
            apart = ~ndimage.binary_dilation(is_group, _NEIGHBOURS, _APART_VOXELS)
            accompanied = np.mean([_has_somebody(moment & apart, static) for moment in moments])
            if accompanied >= _ACCOMPANIED and self._lies_beside(group, is_static, shapes_px):
                found |= group
        return found

    def _lies_beside(self, group: Mask, static: Mask, shapes_px: Sequence[tuple[int, int]]) -> bool:
        """Whether some cameras see most of a group (N,) beside the other static voxels (N,)."""
        n_beside = 0
        for c, shape in enumerate(shapes_px):
            own, others = self._drawn(group, c, shape, 1), self._drawn(static & ~group, c, shape, 1)
            n_beside += bool(own.any() and (own & ~others).sum() >= _BESIDE * own.sum())
        return n_beside >= _CAMERAS_BESIDE

    def _filled(self, voxels: Mask) -> Mask:
        """Voxels (N,) at their places (X, Y, Z)."""
        grid = np.zeros(self._shape, bool)
        grid[self._place] = voxels
        return grid


def _has_somebody(voxels: Mask, static: Mask) -> bool:
    """Whether voxels (X, Y, Z) hold somebody who moves."""
    labels, _ = ndimage.label(voxels, _NEIGHBOURS)
    for k, part in enumerate(ndimage.find_objects(labels)):
        is_part, up = labels[part] == k + 1, part[2]
        if (
            (up.stop - up.start) * COARSE_M >= _PERSON_M
            and up.start * COARSE_M <= _ON_FLOOR_M
            and np.count_nonzero(is_part) >= _PERSON_VOXELS
            and np.mean(~static[part][is_part]) >= _MOVING_SHARE
        ):
            return True
    return False
