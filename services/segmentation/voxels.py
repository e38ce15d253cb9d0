"""Evidence of the other cameras about a pixel: how many of them see no change, at the best place along its
ray.

The place is filled with voxels, coarse ones first, and finer ones where nearly all cameras see a change. The
fewer of the others miss what a pixel's ray meets, the likelier the pixel is the actor's (a visual hull that
each camera is left out of in turn; Laurentini, PAMI 16(2), 1994).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numba
import numpy as np

from services.mocap.camera.camera import Camera, nearest_to_rays_m
from services.mocap.njit import njit_without_refcounts
from services.mocap.side_by_side import N_CORES, side_by_side
from services.mocap.types import Bytes, Floats, Ints, Mask
from services.segmentation.lenses import Lenses, Pixels, raw_of
from services.segmentation.pixels import Levels

COARSE_M, _FINE_M = 0.12, 0.04
"""Sizes of voxels."""
_PER_COARSE = 3
_FINE_OFFSETS_M: Floats = np.ascontiguousarray(
    _FINE_M * (np.indices((3, 3, 3)).reshape(3, -1).T - 1.0), np.float64
)
"""(27, 3) centres of the fine voxels relative to the coarse voxel's centre."""
_LEAST_HALF_SIDE_M, _MOST_HALF_SIDE_M = 1.5, 6.0
"""Limits of half the side of the voxels' square; between them, the cameras' median distance from its
middle."""
_HEIGHT_M = 2.9
_OVER_FLOOR_M = 0.04
"""Voxels start this far above the floor: on the floor there is shadow."""
_SHARES = min(N_CORES, 4)
"""So many cores look into voxels at the same time; each takes room for all pictures."""
_OVERLAP = 1.2
"""A voxel is drawn so many times its size."""
_LEAST_OTHERS, _MANY_OTHERS = 2, 4
"""Fewer others tell nothing; where fewer than so many see a voxel, what each of them misses weighs more."""
_MOST_MISSES, _FEW, _MOST_OF_FEW = 1.5, 5, 0.75
"""Voxels that more of the other cameras miss are not refined; the limit is lower where few others see one."""
MISS = 16
"""Miss of a camera that certainly sees no change at a pixel; 0 if it certainly sees one."""
_INSIDE_MISSES, _NEAR_MISSES, _DEEP_MISSES = 6, 12, 24
"""Of all others together, at most, for the classes below: 0.4, 0.75 and 1.5 times MISS."""

INSIDE, DEEP, NEAR, ONE_MISSES, MORE_MISS, ALONE = range(6)
"""Classes of a pixel: well inside the hull of all other cameras; deep inside the hull of all but one; at the
rim of the hull; missed by one or more; too few other cameras see along its ray. The first four go from inside
to outside: `<=` compares them so."""
CLASS_PRIOR: Levels = np.array([1.0, 0.8, -0.5, -1.0, -4.5, 0.0], np.float32)
"""Default log odds of the actor, by class, before learning. 0: undecided, and never learnt."""
N_CLASSES = len(CLASS_PRIOR)
_NEVER = 255
_WIDE, _NARROW = range(2)
"""Misses of changes that are taken to be a pixel wider than they were seen, which tell that something is
near; and of narrower ones, which tell that it is there."""


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """The voxels that fill the place which the cameras look at."""

    lenses: Lenses
    coarse_m: Floats
    """(N, 3) centres of the coarse voxels that enough cameras see."""
    coarse_px: Pixels
    """(C, N, 2) their positions in the raw pictures."""
    reach_px: Ints
    """(C,) size of a coarse voxel in each camera's picture, an odd number of pixels."""
    covered: list[Mask]
    """Per camera (H, W): whether enough others see along a pixel's ray."""

    @classmethod
    def of(cls, cameras: Sequence[Camera], lenses: Lenses, floor_m: float) -> "VoxelGrid":
        """The voxels of what most cameras look at, over a floor at a height."""
        axes = np.array([camera.R_camera_world[2] for camera in cameras])
        middle = nearest_to_rays_m(np.array([camera.centre_world_m for camera in cameras]), axes)
        away_m = np.median([np.linalg.norm((camera.centre_world_m - middle)[:2]) for camera in cameras])
        half_m = float(np.clip(away_m, _LEAST_HALF_SIDE_M, _MOST_HALF_SIDE_M))
        across = np.arange(-half_m, half_m + COARSE_M / 2, COARSE_M)
        up = floor_m + _OVER_FLOOR_M + np.arange(COARSE_M / 2, _HEIGHT_M, COARSE_M)
        grid = np.stack(np.meshgrid(middle[0] + across, middle[1] + across, up, indexing="ij"), axis=-1)
        points_m = grid.reshape(-1, 3)
        pixels = lenses.project(points_m)
        seen = (pixels[..., 0] >= 0).sum(axis=0) > _LEAST_OTHERS
        points_m, pixels = points_m[seen], np.ascontiguousarray(pixels[:, seen])
        reach_px, covered = np.empty(len(cameras), np.int32), list[Mask]()
        for c, camera in enumerate(cameras):
            depth_m = max(float(np.linalg.norm(camera.centre_world_m - middle)), COARSE_M)
            reach_px[c] = 1 + 2 * round(COARSE_M * camera.K[0, 0] / depth_m / 2)
            drawn = np.zeros(camera.shape_px, np.uint8)
            on = pixels[c][pixels[c][:, 0] >= 0]
            drawn[on[:, 1], on[:, 0]] = 1
            closing = _square(2 * int(reach_px[c]) + 1)
            covered.append(np.asarray(cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, closing) > 0))
        return cls(lenses, points_m, pixels, reach_px, covered)

    def classes(self, misses: Bytes, there: Ints) -> list[Bytes]:
        """The class of each pixel, INSIDE to ALONE (H, W), per present camera.

        misses (C, H, W): each camera's miss at its pixels, 0 to MISS.
        """
        lenses = self.lenses
        wide = np.stack([_eroded(of_camera, 3) for of_camera in misses])
        narrow = np.stack([np.asarray(cv2.dilate(of_camera, _square(3)), np.uint8) for of_camera in misses])
        reaches = self.reach_px.tolist()
        coarse = np.stack([_eroded(n, reach + 2) for n, reach in zip(narrow, reaches, strict=True)])
        # A projection is linear before its division, so a fine voxel's is the sum of two terms.
        P, coarse_m = lenses.P_px_world, self.coarse_m[_promising(self.coarse_px, coarse, there)]
        of_coarse = np.einsum("crk,nk->ncr", P[..., :3], coarse_m) + P[..., 3]
        of_fine = np.einsum("crk,mk->mcr", P[..., :3], _FINE_OFFSETS_M)

        def fewest_of(some: Floats) -> Bytes:
            few = np.full((2, *misses.shape), _NEVER, np.uint8)  # by _WIDE and by _NARROW changes
            at_px = np.empty((2, len(misses)), np.int32)
            _fewest_misses(some, of_fine, lenses.sizes_px, lenses.raw_px, there, wide, narrow, at_px, few)
            return few

        fewest = np.min(side_by_side(fewest_of, np.array_split(of_coarse, _SHARES)), axis=0)
        classes = []
        for c in there:
            width, height = lenses.sizes_px[c]
            size = 1 + 2 * round(int(self.reach_px[c]) / _PER_COARSE * _OVERLAP / 2)
            by_wide, by_narrow = (_eroded(few[c, :height, :width], size) for few in fewest)
            deep = _eroded((by_wide <= _DEEP_MISSES).view(np.uint8), 2 * size + 1)
            of_camera = np.empty(by_wide.shape, np.uint8)
            _classify(by_wide, by_narrow, deep, self.covered[c].view(np.uint8), of_camera)
            classes.append(of_camera)
        return classes


def _square(size_px: int) -> Bytes:
    return np.ones((size_px, size_px), np.uint8)


def _eroded(plane: Bytes, size_px: int) -> Bytes:
    """The smallest value (H, W) in the square around each pixel."""
    return np.asarray(cv2.erode(plane, _square(size_px)), np.uint8)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _classify(by_wide: Bytes, by_narrow: Bytes, deep: Bytes, covered: Bytes, classes: Bytes) -> None:
    """Write the fewest misses of any voxel along a pixel's ray as classes (H, W)."""
    for y in range(classes.shape[0]):
        for x in range(classes.shape[1]):
            near = ONE_MISSES if by_wide[y, x] <= _DEEP_MISSES else MORE_MISS
            near = NEAR if by_wide[y, x] <= _NEAR_MISSES else near
            near = DEEP if deep[y, x] else near
            near = INSIDE if by_narrow[y, x] <= _INSIDE_MISSES else near
            classes[y, x] = near if covered[y, x] else ALONE


@numba.njit(cache=True, nogil=True, inline="always")
def _most(seeing: int) -> int:
    """Largest total miss of a voxel that `seeing` cameras see; one of them may miss it completely."""
    return int(MISS * (1.0 + (_MOST_MISSES if seeing > _FEW else _MOST_OF_FEW)))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _promising(coarse_px: Pixels, misses: Bytes, there: Ints) -> Mask:
    """Coarse voxels (N,) that few enough cameras miss, so that the actor may be in them."""
    promising = np.zeros(coarse_px.shape[1], np.bool_)
    most = _most(len(there))
    for i in range(coarse_px.shape[1]):
        seeing = missed = 0
        for c in there:
            column, row = coarse_px[c, i, 0], coarse_px[c, i, 1]
            if column >= 0:
                seeing += 1
                missed += misses[c, row, column]
                if missed > most:
                    break
        promising[i] = seeing > _LEAST_OTHERS and missed <= _most(seeing)
    return promising


@njit_without_refcounts
def _fewest_misses(
    of_coarse: Floats, of_fine: Floats, sizes_px: Ints, raw_px: Pixels, there: Ints, wide: Bytes,
    narrow: Bytes, at_px: Ints, fewest: Bytes,
) -> None:  # fmt: skip
    """Write to fewest (2, C, H, W) how much the others miss of the voxel at each pixel that they miss least.

    By the wide changes and by the narrow ones (C, H, W), over the fine voxels in coarse ones. Column, row and
    depth of a voxel's projection, the first two times the third, are those of its coarse one (N, C, 3) and of
    its place in there (M, C, 3) together. at_px (2, C): room for columns and rows.
    """
    columns, rows = at_px
    most, usual_others = _most(len(there)), min(_MANY_OTHERS, len(there) - 1)
    for i in range(len(of_coarse)):
        for k in range(len(of_fine)):
            seeing = by_wide = by_narrow = 0
            for c in there:
                p, q = of_coarse[i, c], of_fine[k, c]
                column, row = raw_of(p[0] + q[0], p[1] + q[1], p[2] + q[2], sizes_px[c], raw_px[c])
                columns[c], rows[c] = column, row
                if column >= 0:
                    seeing += 1
                    by_wide += wide[c, row, column]
                    by_narrow += narrow[c, row, column]
                    if by_wide > most:
                        break
            if seeing <= _LEAST_OTHERS or by_wide > _most(seeing):
                continue
            # If few cameras see a voxel, their misses are scaled to the usual number of cameras.
            share = max(usual_others / (seeing - 1), 1.0)
            for c in there:
                u, v = columns[c], rows[c]
                if u >= 0:
                    wide_misses = min(share * (by_wide - wide[c, v, u]), _NEVER)
                    narrow_misses = min(share * (by_narrow - narrow[c, v, u]), _NEVER)
                    fewest[_WIDE, c, v, u] = min(fewest[_WIDE, c, v, u], int(wide_misses))
                    fewest[_NARROW, c, v, u] = min(fewest[_NARROW, c, v, u], int(narrow_misses))
