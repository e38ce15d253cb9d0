"""A coarse visual hull: the space in which the actor can be, from one frame's silhouettes."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numba
import numpy as np
from scipy import ndimage

from services.mocap.camera.rig import Rig
from services.mocap.errors import TakeError
from services.mocap.types import Bytes, Floats, Ints, Mask

_VOXEL_M = 0.03
_FEET_M = 0.15
"""Height above the hull's lowest point within which the feet are searched."""
_REACH_M = 1.6
"""Half the side of the cube that is carved, about the point where the silhouettes' centres meet."""
MIN_CAMERAS = 2
"""A single camera gives no distances."""
_SLACK_PX = 1
"""Silhouettes are dilated by this much per 320 pixels of width, because of ragged edges and the voxels'
size."""
_LEAST_ANGLE_RAD = 0.05
"""Rays closer to parallel than this, about 3 degrees, do not determine the distance of their meeting
point."""
_ROUNDS = 20
"""Iterations of reweighting until the meeting point no longer moves; a few are enough unless a camera is far
off."""
_NEAR_M = 0.05
"""Rays that pass this close to the meeting point have equal weights."""
_CAMERAS_PER_MISS = 8
_STACKED_WITHIN_M, _STACKED_OVERLAP_M, _LEAST_STACKED = 0.6, 0.1, 0.02
"""Pieces of a hull are one above the other if their middles are this near in plan, and they share no more
height than this; a shank has this share of the points of the rest at least."""
_SPAN = (0.05, 0.95)
"""Quantiles of the heights between which a piece is: arms may hang beside furniture."""
_MOST_PIECES = 6
_CROUCHING, _ARMS_RAISED = 0.4, 1.5
"""Ratio of the visual hull's height to the actor's."""


@dataclass(frozen=True, eq=False)
class Hull:
    """Voxel centres of the largest piece of the visual hull (see stacked)."""

    points_world_m: Floats
    """(N, 3) including space that unsure pixels leave open."""
    firm: Mask
    """(N,) points at which at least half of the cameras that look there certainly see the actor, used for
    measuring; without any, all are."""

    @property
    def _firm_m(self) -> Floats:
        return self.points_world_m[self.firm] if self.firm.any() else self.points_world_m

    @property
    def bottom_m(self) -> float:
        """Height of the soles (see _bottom_m)."""
        return _bottom_m(self._firm_m)

    @property
    def height_m(self) -> float:
        """From the soles to the highest point.

        Measured between centres: the dilation of the silhouettes makes up for half of the outermost voxels.
        """
        return float(self._firm_m[:, 2].max()) - self.bottom_m

    @property
    def axis_world_m(self) -> Floats:
        """(2,) x and y of the middle."""
        return np.median(self._firm_m[:, :2], axis=0)

    @property
    def middle_world_m(self) -> Floats:
        """(3,) the mean of its points."""
        return np.asarray(self._firm_m.mean(axis=0))

    def suits(self, height_m: float) -> bool:
        """Whether it may belong to an actor of this height, from crouching to arms raised."""
        return self.may_be(_CROUCHING * height_m, _ARMS_RAISED * height_m)

    def lies(self, height_m: float) -> bool:
        """Whether it may belong to an actor of this height who lies or crawls: it is long, and low."""
        apart_m = self._firm_m[:, :2] - self.axis_world_m
        _, directions = np.linalg.eigh(apart_m.T @ apart_m)
        length_m = float(np.ptp(apart_m @ directions[:, -1]))
        return self.height_m < _CROUCHING * height_m < length_m < _ARMS_RAISED * height_m

    def may_be(self, low_m: float, high_m: float) -> bool:
        """Whether the height is within a range, or may be because of unsure pixels."""
        most_m = float(self.points_world_m[:, 2].max()) - _bottom_m(self.points_world_m)
        return self.height_m <= high_m and max(self.height_m, most_m) >= low_m


def _bottom_m(points_world_m: Floats) -> float:
    """The height of the lowest layer of voxels that is at least half as wide as the feet's widest.

    Cameras look down at the feet and do not see the floor under them, so the hull ends in a tip there.
    """
    z_m = points_world_m[:, 2]
    layers = np.rint((z_m - z_m.min()) / _VOXEL_M).astype(np.int64)
    feet = np.bincount(layers)[: round(_FEET_M / _VOXEL_M)]
    return float(z_m.min() + int(np.argmax(2 * feet >= feet.max())) * _VOXEL_M)


def carve(rig: Rig, silhouettes: Mask, possible: Mask | None = None) -> Hull:
    """Carve the hull from silhouettes (C, H, W); a camera that shows nothing does not count.

    possible (C, H, W): possible actor pixels, by default the silhouettes; space outside is carved away.
    Where more than eight cameras look, one of every eight may miss what furniture hides from it. Raises
    TakeError if nobody is visible, or the silhouettes do not meet in space.
    """
    seen = [c for c in range(rig.n_cameras) if silhouettes[c].any()]
    if len(seen) < MIN_CAMERAS:
        raise TakeError(
            f"silhouettes: only {len(seen)} of {rig.n_cameras} cameras show a person in the first frame: "
            "choose a first frame in which the actor is in view"
        )
    possible = silhouettes if possible is None else possible
    points_world_m = cube_about(meeting_point(rig, silhouettes, seen), _REACH_M, _VOXEL_M)
    inside = in_hull(*looked_at(rig, possible, seen, points_world_m), most_missed(len(seen)))
    in_picture, on_actor = looked_at(rig, silhouettes, seen, points_world_m[inside])
    firm = inside.copy()
    firm[inside] = 2 * on_actor.sum(axis=0) >= in_picture.sum(axis=0)
    pieces = pieces_of(inside, firm)
    if not pieces.any():
        raise TakeError(
            "calibration.toml: the cameras' silhouettes do not meet anywhere in space: check that the "
            "calibration belongs to this take and that the videos are synchronised"
        )
    largest = stacked(points_world_m, pieces) == 1
    return Hull(points_world_m[largest], firm[largest])


def looked_at(rig: Rig, masks: Mask, cameras: Sequence[int], points_world_m: Floats) -> tuple[Mask, Mask]:
    """See look_up: (K, N) for K cameras, whose masks are in (C, H, W)."""
    looks = np.zeros((2, len(cameras), len(points_world_m)), bool)
    for k, c in enumerate(cameras):
        looks[:, k] = look_up(rig, masks[c], c, points_world_m)
    return looks[0], looks[1]


def in_hull(in_picture: Mask, on_actor: Mask, n_missed: int) -> Mask:
    """The points (N,) in the hull of K cameras of which n_missed may miss a point; see looked_at.

    Where few cameras look, little is carved away, so half of the cameras must have a point in their picture.
    """
    n_cameras, n_pictures = len(in_picture), in_picture.sum(axis=0)
    enough = 2 * n_pictures >= max(n_cameras, 2 * min(MIN_CAMERAS, n_cameras))
    inside: Mask = enough & (n_pictures - on_actor.sum(axis=0) <= n_missed)
    return inside


def most_missed(n_cameras: int) -> int:
    """How many cameras may miss a point of a hull: furniture may hide it from them."""
    return (n_cameras - 1) // _CAMERAS_PER_MISS


def pieces_of(inside: Mask, firm: Mask | None = None, *, bridged: bool = False) -> Ints:
    """Number the connected pieces of a cube's points (N,), the largest first, from 1 on; 0 outside.

    firm (N,): points that decide the order; all points decide between equal pieces. bridged: pieces two
    points apart are one, as something in the foreground may have cut a person apart.
    """
    side = round(len(inside) ** (1 / 3))
    cube = inside.reshape(side, side, side)
    labels, n_pieces = ndimage.label(ndimage.binary_dilation(cube) if bridged else cube)
    labels *= cube
    sizes = np.bincount(labels.ravel(), minlength=n_pieces + 1)[1:]
    if firm is not None:
        firm_sizes = np.bincount(labels.ravel()[firm], minlength=n_pieces + 1)[1:]
        sizes = sizes + (len(inside) + 1) * firm_sizes
    rank: Ints = np.zeros(n_pieces + 1, np.int32)
    rank[1 + np.argsort(-sizes, kind="stable")] = 1 + np.arange(n_pieces)
    pieces: Ints = rank[labels.ravel()]
    return pieces


def stacked(points_world_m: Floats, pieces: Ints) -> Ints:
    """Pieces (N,) of a hull's points (N, 3), with those over or under the first one as part of it.

    People stand beside each other: what is above and below is one actor whose middle furniture hides from
    some camera. Small pieces stay what they are.
    """
    joined, sizes = pieces.copy(), np.bincount(pieces)
    if len(sizes) < 3:
        return joined
    spans = [_span_m(points_world_m[pieces == 1 + n]) for n in range(min(len(sizes) - 1, _MOST_PIECES))]
    (x, y, low_m, high_m), *others = spans
    for n, (at_x, at_y, other_low_m, other_high_m) in enumerate(others):
        shared_m = min(high_m, other_high_m) - max(low_m, other_low_m)
        is_near = np.hypot(at_x - x, at_y - y) < _STACKED_WITHIN_M
        if sizes[2 + n] >= _LEAST_STACKED * sizes[1] and is_near and shared_m < _STACKED_OVERLAP_M:
            joined[pieces == 2 + n] = 1
    return joined


def _span_m(points_world_m: Floats) -> tuple[float, float, float, float]:
    """x and y of the middle of some points (N, 3), and the heights between which most of them are."""
    x, y = np.median(points_world_m[:, :2], axis=0)
    low_m, high_m = np.quantile(points_world_m[:, 2], _SPAN)
    return float(x), float(y), float(low_m), float(high_m)


def meeting_point(rig: Rig, silhouettes: Mask, cameras: list[int]) -> Floats:
    """The point (3,) in the world nearest to the rays through the centres of some cameras' silhouettes.

    Minimises the sum of distances, not of squares, so that a wrong camera has little influence. Raises
    TakeError if all rays are parallel, or their meeting point is behind the cameras.
    """
    centres_m, rays = _centre_rays(rig, silhouettes, cameras)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    parallel = np.linalg.eigvalsh(across.mean(axis=0))[0] < _LEAST_ANGLE_RAD**2 / 4
    if parallel or np.ptp(centres_m, axis=0).max() < _NEAR_M:
        raise TakeError(
            "calibration.toml: all cameras see the actor in the same direction, which does not show how far "
            "away the actor is: check that no two cameras have the same rotation and translation"
        )
    weights, point_m = np.ones(len(rays)), np.zeros(3)
    for _ in range(_ROUNDS):
        weighted = across * weights[:, None, None]
        point_m = np.linalg.solve(weighted.sum(axis=0), np.einsum("cij,cj->i", weighted, centres_m))
        off_m = np.linalg.norm(np.einsum("cij,cj->ci", across, point_m - centres_m), axis=1)
        weights = 1.0 / np.maximum(off_m, _NEAR_M)
    ahead_m = np.einsum("ci,ci->c", point_m - centres_m, rays)
    if 2 * np.count_nonzero(ahead_m > 0) < len(rays):
        raise TakeError(
            "calibration.toml: the cameras' rays meet behind them: check that rotation and translation "
            "transform points from the world to the camera, not the reverse"
        )
    return point_m.astype(np.float64)


def _centre_rays(rig: Rig, silhouettes: Mask, cameras: list[int]) -> tuple[Floats, Floats]:
    """Camera centres (N, 3) in the world, and unit rays (N, 3) forward through the silhouettes' centres."""
    centres_m, rays = np.empty((len(cameras), 3)), np.empty((len(cameras), 3))
    for k, c in enumerate(cameras):
        y, x = np.nonzero(silhouettes[c])
        M, p = rig.P_px_world[c, :, :3], rig.P_px_world[c, :, 3]
        centres_m[k] = -np.linalg.solve(M, p)
        rays[k] = np.linalg.solve(M, np.array([x.mean(), y.mean(), 1.0]))
    return centres_m, rays / np.linalg.norm(rays, axis=1)[:, None]


def cube_about(centre_world_m: Floats, reach_m: float, voxel_m: float) -> Floats:
    """Voxel centres (n ** 3, 3) of a cube about a point, reach_m to each side."""
    steps = np.arange(-reach_m, reach_m + voxel_m / 2, voxel_m)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    points_world_m: Floats = grid.reshape(-1, 3) + centre_world_m
    return points_world_m


def look_up(rig: Rig, silhouette: Mask, camera: int, points_world_m: Floats) -> tuple[Mask, Mask]:
    """Which points (N,) project into a camera's picture, and which onto its silhouette (H, W)."""
    width, height = rig.sizes_px[camera]
    size = 1 + 2 * max(1, round(_SLACK_PX * width / 320))
    wide: Bytes = np.asarray(
        cv2.dilate(silhouette[:height, :width].astype(np.uint8), np.ones((size, size), np.uint8)), np.uint8
    )
    in_picture, on_actor = np.zeros((2, len(points_world_m)), bool)
    _project(np.ascontiguousarray(points_world_m), rig.P_px_world[camera], wide, in_picture, on_actor)
    return in_picture, on_actor


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project(
    points_world_m: Floats, P_px_world: Floats, picture: Bytes, inside: Mask, on_white: Mask
) -> None:
    """Mark which points (N, 3) project into a picture (h, w), and which onto non-black pixels."""
    height, width = picture.shape
    for n in range(len(points_world_m)):
        x, y, z = points_world_m[n]
        depth = P_px_world[2, 0] * x + P_px_world[2, 1] * y + P_px_world[2, 2] * z + P_px_world[2, 3]
        if depth <= 0:
            continue
        across = P_px_world[0, 0] * x + P_px_world[0, 1] * y + P_px_world[0, 2] * z + P_px_world[0, 3]
        down = P_px_world[1, 0] * x + P_px_world[1, 1] * y + P_px_world[1, 2] * z + P_px_world[1, 3]
        column, row = np.rint(across / depth), np.rint(down / depth)
        if 0 <= column < width and 0 <= row < height:
            inside[n] = True
            on_white[n] = picture[int(row), int(column)] > 0
