"""Level of detail: closed meshes of ever fewer faces, each with how far its surface lies from the full one.

If no point of either surface lies farther than e from the other surface, then no point of either silhouette
lies farther than about f e / z pixels from the other silhouette (focal length f in pixels, depth z).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from threading import Lock

import fast_simplification
import numba
import numpy as np

from services.mocap.body.surface import FEWEST_FACES, Level, is_closed, volume_m3
from services.mocap.energy.detail.bound import farthest_bound
from services.mocap.energy.detail.distance import Tree, farthest_point, tree_of
from services.mocap.types import Floats, Ints

ERRORS_M = (0.0015, 0.003, 0.006, 0.012)
"""Half a pixel at 4 m for pictures 1280, 640, 320 and 160 pixels wide."""
_WORTH = 0.7  # of the faces of the level before: what has more is not worth having
_TRIES = 6  # to guess the number of faces
_PROOFS = 4  # that a number of faces will do
_CLOSE = 0.86  # of the error allowed: near enough
_ENOUGH = 0.9  # of the error allowed: smaller ones are not told apart
_AIM = 0.95  # of the error allowed, when guessing a number of faces
_HASTE = 6.0  # of the thinning: with more, the allowed cost of a step grows faster
_LARGEST_SHIFT = 1.0 / 6.0  # of the error allowed, when a mesh is given its area back
_thinner = Lock()  # fast_simplification keeps its mesh in global variables


@dataclass(frozen=True, eq=False)
class _Full:
    """The mesh that is thinned."""

    vertices_m: Floats
    faces: Ints
    corners_m: Floats
    tree: Tree
    area_m2: float

    @classmethod
    def of(cls, vertices_m: Floats, faces: Ints) -> "_Full":
        """A mesh, without the vertices that no face has."""
        used, compact = np.unique(faces, return_inverse=True)
        kept_m = np.ascontiguousarray(vertices_m[used], np.float64)
        kept_faces = compact.reshape(-1, 3).astype(np.int32)
        corners_m = kept_m[kept_faces]
        area_m2 = float(_normals_and_area(kept_m, kept_faces)[1])
        return cls(kept_m, kept_faces, corners_m, tree_of(kept_m, kept_faces), area_m2)


def thinned_levels(vertices_m: Floats, faces: Ints, errors_m: Sequence[float] = ERRORS_M) -> list[Level]:
    """Thin a closed mesh, vertices_m (V, 3) and faces (F, 3), as far as each of errors_m allows.

    From fine to coarse, without the mesh itself. Each is closed and has at most 70 % of the faces of the
    level before it; where that cannot be had it is left out, so that a mesh with hardly any faces has none,
    nor has one that is not closed or is inside out. Levels keep the area of the surface, and with it the mean
    area of the silhouettes. The same mesh always gives the same levels.
    """
    levels: list[Level] = []
    if not is_closed(faces):
        return levels
    full = _Full.of(vertices_m, faces)
    n_before, guess = len(faces), len(faces) / 3
    for error_m in sorted(errors_m):
        level = _coarsest(full, error_m, guess, int(_WORTH * n_before))
        if level is not None:
            levels.append(level)
            n_before, guess = len(level.faces), len(level.faces) / 2
    return levels


def _coarsest(full: _Full, error_m: float, guess: float, most: int) -> Level | None:
    """The level of about the fewest faces that stays within error_m; None if it has more faces than most."""
    n_faces = _fewest_likely(full, error_m, guess, most)
    for _ in range(_PROOFS):
        if n_faces > most:
            break
        vertices_m, faces = _thinned(full, n_faces, error_m)
        if len(faces) <= most and _estimated_error(full, vertices_m, faces) <= error_m:
            bound_m = _bounded_error(full, vertices_m, faces, error_m)
            if bound_m <= error_m:
                return Level(vertices_m, faces, bound_m)
        n_faces = max(len(faces), n_faces) * 8 // 7 + 1
    return None


def _fewest_likely(full: _Full, error_m: float, guess: float, most: int) -> int:
    """About how few faces keep the corners of the full mesh within error_m, by trial; over most if none."""
    too_few, enough, n_faces = FEWEST_FACES - 1, most + 1, min(round(guess), most)
    for _ in range(_TRIES):
        if not too_few < n_faces < enough:
            break
        estimate_m = _estimated_error(full, *_thinned(full, n_faces, error_m))
        if not np.isfinite(estimate_m):  # says nothing of other numbers of faces
            n_faces = round(sqrt(too_few * n_faces))
            continue
        if estimate_m > error_m:
            too_few = n_faces
        else:
            enough = n_faces
            if estimate_m > _CLOSE * error_m:
                break
        ratio = (enough / too_few) ** 0.2  # the error falls about as the number of faces grows
        n_faces = round(min(max(n_faces * estimate_m / (_AIM * error_m), too_few * ratio), enough / ratio))
    return enough


def _estimated_error(full: _Full, vertices_m: Floats, faces: Ints) -> float:
    """How far a corner of the full mesh lies from a thinned one at most; infinity if that is not closed."""
    if not is_closed(faces) or volume_m3(vertices_m, faces) <= 0.0:
        return np.inf
    return float(farthest_point(full.vertices_m, tree_of(vertices_m, faces)))


def _bounded_error(full: _Full, vertices_m: Floats, faces: Ints, error_m: float) -> float:
    """An upper bound of how far either surface lies from the other; infinite if it is beyond error_m."""
    enough_m = _ENOUGH * error_m
    bound_m = farthest_bound(full.corners_m, tree_of(vertices_m, faces), enough_m, error_m)
    if bound_m > error_m:
        return np.inf
    return float(max(bound_m, farthest_bound(vertices_m[faces], full.tree, enough_m, error_m)))


def _thinned(full: _Full, n_faces: int, error_m: float) -> tuple[Floats, Ints]:
    """The mesh thinned to about n_faces, and blown up a little to keep its area."""
    with _thinner:  # it counts in units of the error, because its steps are of fixed size
        vertices, faces = fast_simplification.simplify(
            full.vertices_m / error_m, full.faces.copy(), target_count=n_faces, agg=_HASTE
        )
    vertices_m: Floats = vertices * error_m
    if len(faces) >= FEWEST_FACES:
        _keep_area(vertices_m, faces, full.area_m2, _LARGEST_SHIFT * error_m)
    return vertices_m, faces


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _keep_area(vertices_m: Floats, faces: Ints, area_m2: float, most_m: float) -> None:
    """Move vertices along their normals, all by the same and no more than most_m, until the area is right.

    For a convex body the mean area of its silhouettes is a quarter of its surface's (Cauchy). Thinning
    shrinks it by up to some percent; with its area back, silhouettes are as large as before on average.
    """
    shifted_m, step_m = 0.0, 1e-3 * most_m
    for _ in range(3):
        normals, before_m2 = _normals_and_area(vertices_m, faces)
        gain_m = (_normals_and_area(vertices_m + step_m * normals, faces)[1] - before_m2) / step_m
        if not gain_m > 0.0:
            return
        shift_m = min(max((area_m2 - before_m2) / gain_m, -most_m - shifted_m), most_m - shifted_m)
        vertices_m += shift_m * normals
        shifted_m += shift_m


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _normals_and_area(vertices_m: Floats, faces: Ints) -> tuple[Floats, float]:
    """Unit normals (V, 3) of vertices, and the surface's area."""
    normals, doubled_m2 = np.zeros(vertices_m.shape), 0.0
    for f in range(len(faces)):
        a, b, c = vertices_m[faces[f, 0]], vertices_m[faces[f, 1]], vertices_m[faces[f, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        doubled_m2 += sqrt(nx * nx + ny * ny + nz * nz)
        for i in range(3):
            normal = normals[faces[f, i]]
            normal[0] += nx
            normal[1] += ny
            normal[2] += nz
    for v in range(len(normals)):
        x, y, z = normals[v]
        normals[v] /= max(sqrt(x * x + y * y + z * z), 1e-30)
    return normals, doubled_m2 / 2.0
