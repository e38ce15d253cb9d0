"""Shadow on the floor: every camera that sees a place in shadow sees it dark.

A floor point in shadow is dark in all cameras; a shin in front of the floor is not, because other cameras see
the floor behind it lit. Cameras from which something hides the point know nothing of it (floor_views).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numba
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.njit import njit_without_refcounts
from services.mocap.side_by_side import side_by_side
from services.mocap.types import Bytes, Floats, Ints
from services.segmentation.cleanup import Part
from services.segmentation.comparison import CHANGED, PERHAPS_EDGE, PERHAPS_SHADOW, UNCHANGED
from services.segmentation.floor_views import hidden_floor, is_hidden, nothing_hidden
from services.segmentation.lenses import Lenses, Pixels, raw_pixel, rays_of
from services.segmentation.pixels import Levels, Steps
from services.segmentation.plate import LEAST_RATIO, MOST_RATIO

SUPPORTED = np.float32(1.0)
"""Log odds of shadow where another camera sees the same shadow on the floor."""
SUPPORTED_EDGE = np.float32(-1.0)
"""Log odds where another camera sees a possible shadow edge there."""
UNSUPPORTED = np.float32(-5.0)
"""Log odds where other cameras see the place and none sees a shadow there."""
REFUTED = np.float32(-3.0)
"""Added for each camera that sees the place in light; each that sees the shadow, but the first, cancels
one."""
UNKNOWN = np.float32(-3.0)
"""Log odds where no other camera sees the place, or the floor is unknown."""
ON_ITS_OWN = np.float32(-1.0)
"""Log odds without any other camera: only colour and texture indicate shadow."""
_AGREED = 0.1
"""Share of the possible shadow pixels that other cameras must support for the floor to be known."""
_SURELY_AGREED = 0.35
"""Below this at the world's origin, other heights are tried; one of them counts only from this on."""
_BETTER = 2.5
"""How many times better another height must be: a plane through grey clothes agrees with itself to some
degree."""
_HEIGHTS_M, _FINER_M = np.arange(-0.8, 0.81, 0.1), np.array([-0.05, -0.025, 0.025, 0.05])
_BLOCKS_ACROSS = 160
"""Blocks across a picture's width; other cameras are asked once per block."""
_DARKNESS_BINS = 32
"""Of a histogram of ratios, the brightness in shadow over that in light."""
_LEAST_CONFIRMED_PX = 1000
"""So many confirmed pixels tell how dark shadows are."""
_RATIOS = float(LEAST_RATIO), float(MOST_RATIO)
"""Of a possible shadow, at least and at most."""
_NOTHING_KNOWN: Levels = np.zeros(_DARKNESS_BINS, np.float32)
_SAME_RATIO = np.float32(0.1)
_FARTHEST_M = 30.0
_N_SEEN = 4
_SEEING, _LIT, _ALIKE, _BEST = range(_N_SEEN)
"""Of a place on the floor: how many cameras see it, see it in light, and see it as dark; the state most like
shadow that one of them sees."""


@dataclass(frozen=True, eq=False)
class Floor:
    """The floor as each camera's pixels see it."""

    height_m: float
    places_m: list[Levels]
    """Per camera (H, W, 2): the floor point that a raw pixel sees, x and y in the world; NaN off the
    floor."""
    hidden: Bytes
    """(C, N, N) places that something hides from each camera, as hidden_floor returns them."""
    darkness_odds: Levels = field(default_factory=lambda: _NOTHING_KNOWN)
    """(_DARKNESS_BINS,) what its ratio adds to the log odds of shadow of a pixel that no other camera
    confirms: shadows of one lamp are about equally dark, so one as dark as confirmed ones is likelier."""

    @classmethod
    def at(cls, height_m: float, cameras: Sequence[Camera], hidden: Bytes | None = None) -> "Floor":
        """The floor at a height over the world's origin; hidden: nothing by default."""

        def places_m(camera: Camera) -> Levels:
            centre_m, rays = rays_of(camera)
            with np.errstate(divide="ignore", invalid="ignore"):
                along = (height_m - centre_m[2]) / rays[..., 2]
                places = centre_m[:2] + along[..., None] * rays[..., :2]
            is_far = np.linalg.norm(places - centre_m[:2], axis=-1) > _FARTHEST_M
            places[~(along > 0) | is_far] = np.nan
            return np.asarray(places, np.float32)

        hidden = nothing_hidden(len(cameras)) if hidden is None else hidden
        return cls(height_m, side_by_side(places_m, cameras), hidden)

    def shadow_prior(
        self, camera: int, part: Part | None, lenses: Lenses, ratios: Levels, states: Bytes, there: Ints
    ) -> Levels:
        """(H, W) log odds of shadow against light where a camera's picture may show shadow.

        part: the part of the picture that may show shadow; None if there is none.
        ratios, states (C, H, W): of all Comparisons; there: the cameras that have a picture. Elsewhere it is
        UNKNOWN.
        """
        width, height = lenses.sizes_px[camera]
        prior = np.full((height, width), UNKNOWN, np.float32)
        if part is None:
            return prior
        block_px, (rows, columns) = max(2, round(width / _BLOCKS_ACROSS)), part
        within = rows.start, rows.stop, columns.start, columns.stop
        _vote(
            self.places_m[camera], self.height_m, lenses.P_px_world, lenses.sizes_px, lenses.raw_px,
            there[there != camera], self.hidden, ratios[camera], states[camera], ratios, states, block_px,
            within, prior,
        )  # fmt: skip
        _add_darkness(prior, ratios[camera], states[camera], self.darkness_odds, within)
        return prior


def find_floor(
    cameras: Sequence[Camera],
    lenses: Lenses,
    moments: Sequence[tuple[Levels, Bytes, Ints]],
    plate_means: Sequence[Steps] = (),
) -> Floor | None:
    """The floor at the height at which cameras agree best on shadows, and how dark these are; None if they do
    not agree.

    moments: ratios (C, H, W), states (C, H, W) and cameras that have a picture. plate_means: of each camera's
    plate (3, H, W), in steps, which tell what hides the floor. The world's origin is tried first.
    """

    def floor_at(height_m: float) -> Floor:
        hidden = hidden_floor(height_m, lenses, plate_means) if plate_means else None
        return Floor.at(height_m, cameras, hidden)

    floor = _agreed_floor(floor_at, lenses, moments)
    if floor is None:
        return None
    return replace(floor, darkness_odds=_darkness_odds(floor, lenses, moments))


def _agreed_floor(
    floor_at: Callable[[float], Floor], lenses: Lenses, moments: Sequence[tuple[Levels, Bytes, Ints]]
) -> Floor | None:
    origin = floor_at(0.0)
    at_origin = _agreement(origin, lenses, moments)
    if at_origin >= _SURELY_AGREED:
        return origin
    best, agreed = origin, _BETTER * at_origin
    for steps_m in (_HEIGHTS_M, _FINER_M):
        for height_m in best.height_m + steps_m:
            floor = floor_at(float(height_m))
            agreement = _agreement(floor, lenses, moments)
            if agreement > agreed:
                best, agreed = floor, agreement
    if best is not origin and agreed >= _SURELY_AGREED:
        return best
    return origin if at_origin >= _AGREED else None


def _agreement(floor: Floor, lenses: Lenses, moments: Sequence[tuple[Levels, Bytes, Ints]]) -> float:
    """The share of all possible shadow pixels that another camera supports."""
    is_supported = [odds >= SUPPORTED for odds, _ in _possible_shadows(floor, lenses, moments)]
    return sum(map(np.count_nonzero, is_supported)) / max(sum(map(len, is_supported)), 1)


def _darkness_odds(floor: Floor, lenses: Lenses, moments: Sequence[tuple[Levels, Bytes, Ints]]) -> Levels:
    """See Floor.darkness_odds; moments as in find_floor. Zeros if too few shadows are confirmed."""
    counts = np.zeros(_DARKNESS_BINS)
    for odds, ratios in _possible_shadows(floor, lenses, moments):
        counts += np.histogram(ratios[odds >= SUPPORTED], _DARKNESS_BINS, _RATIOS)[0]
    if counts.sum() < _LEAST_CONFIRMED_PX:
        return _NOTHING_KNOWN
    # The density of ratios over that of the model of shadow, in which all are equally likely.
    density = _DARKNESS_BINS * np.convolve(counts / counts.sum(), (0.25, 0.5, 0.25), "same")
    return np.asarray(np.log(np.maximum(density, 1.0)), np.float32)


def _possible_shadows(
    floor: Floor, lenses: Lenses, moments: Sequence[tuple[Levels, Bytes, Ints]]
) -> Iterator[tuple[Levels, Levels]]:
    """Of each picture the log odds of shadow (N,) and the ratios (N,) of pixels that may show shadow."""
    for ratios, states, there in moments:
        for c in map(int, there):
            width, height = lenses.sizes_px[c]
            whole = slice(0, int(height)), slice(0, int(width))
            shadowed = states[c][whole] == PERHAPS_SHADOW
            odds = floor.shadow_prior(c, whole, lenses, ratios, states, there)
            yield odds[shadowed], ratios[c][whole][shadowed]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_darkness(
    odds: Levels, ratio: Levels, state: Bytes, darkness_odds: Levels, within: tuple[int, int, int, int]
) -> None:
    """Add to the log odds (H, W) of pixels within rows and columns, with these ratios and states (H, W), what
    their darkness tells."""
    first_row, end_row, first_column, end_column = within
    bins_per_ratio = len(darkness_odds) / (MOST_RATIO - LEAST_RATIO)
    for y in range(first_row, end_row):
        for x in range(first_column, end_column):
            if state[y, x] == PERHAPS_SHADOW and odds[y, x] < SUPPORTED:
                place = int((ratio[y, x] - LEAST_RATIO) * bins_per_ratio)
                odds[y, x] += darkness_odds[min(max(place, 0), len(darkness_odds) - 1)]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _vote(
    places_m: Levels, height_m: float, P_px_world: Floats, sizes_px: Ints, raw_px: Pixels, others: Ints,
    hidden: Bytes, ratio: Levels, state: Bytes, ratios: Levels, states: Bytes, block_px: int,
    within: tuple[int, int, int, int], prior: Levels,
) -> None:  # fmt: skip
    """Write the prior of pixels within rows and columns, block by block, because shadow has no finer
    detail."""
    first_row, end_row, first_column, end_column = within
    # The grid of blocks is the same in all pictures, wherever the part begins.
    tops = range(first_row // block_px * block_px, end_row, block_px)
    lefts = range(first_column // block_px * block_px, end_column, block_px)
    corners_px = np.empty((len(tops) * len(lefts), 2), np.int32)
    dark_m, darkness = np.empty((len(corners_px), 2), np.float32), np.empty(len(corners_px), np.float32)
    n = 0
    for top in tops:
        for left in lefts:
            bottom, right = min(top + block_px, end_row), min(left + block_px, end_column)
            y, x = _most_like_shadow(state, places_m, top, bottom, left, right)
            if y >= 0:
                corners_px[n, 0], corners_px[n, 1] = top, left
                dark_m[n, 0], dark_m[n, 1], darkness[n] = places_m[y, x, 0], places_m[y, x, 1], ratio[y, x]
                n += 1
    seen = np.zeros((n, _N_SEEN), np.int32)
    for j in others:  # one after the other, so that what is known of one stays in the processor's cache
        _ask(
            dark_m[:n], height_m, darkness, P_px_world[j], sizes_px[j], raw_px[j], hidden, j, states[j],
            ratios[j], seen,
        )  # fmt: skip
    for i in range(n):
        top, left = corners_px[i]
        odds = _odds(seen[i])
        for y in range(top, min(top + block_px, end_row)):
            for x in range(left, min(left + block_px, end_column)):
                prior[y, x] = odds


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _most_like_shadow(
    state: Bytes, places_m: Levels, top: int, bottom: int, left: int, right: int
) -> tuple[int, int]:
    """Row and column of the most shadow-like pixel of a block in front of the floor; -1 for none."""
    row, column, most = -1, -1, CHANGED
    for y in range(top, bottom):
        for x in range(left, right):
            if state[y, x] > most and places_m[y, x, 0] == places_m[y, x, 0]:
                row, column, most = y, x, state[y, x]
    return row, column


@njit_without_refcounts
def _ask(
    places_m: Levels, height_m: float, darkness: Levels, P_px_world: Floats, size_px: Ints, raw_px: Pixels,
    hidden: Bytes, camera: int, state: Bytes, ratio: Levels, seen: Ints,
) -> None:  # fmt: skip
    """Add to seen (n, _N_SEEN) what a camera sees at places (n, 2) on the floor with this darkness (n,)."""
    for i in range(len(places_m)):
        x_m, y_m = places_m[i, 0], places_m[i, 1]
        column, row = raw_pixel(P_px_world, size_px, raw_px, x_m, y_m, height_m)
        if column < 0:
            continue
        found = _look(state, ratio, size_px, column, row, darkness[i])
        if found < PERHAPS_EDGE and is_hidden(hidden, camera, x_m, y_m):
            continue
        seen[i, _SEEING] += 1
        seen[i, _LIT] += found == UNCHANGED
        seen[i, _ALIKE] += found >= PERHAPS_EDGE
        seen[i, _BEST] = max(seen[i, _BEST], found)


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _odds(seen: Ints) -> np.float32:
    """Log odds of shadow at a place on the floor, from what the other cameras see there (_N_SEEN,)."""
    if seen[_SEEING] == 0:
        return UNKNOWN
    # Furniture of the floor's colour may hide a place from some cameras, which then see no change; several
    # cameras that see the shadow outweigh them.
    refuted = np.float32(max(seen[_LIT] - max(seen[_ALIKE] - 1, 0), 0)) * REFUTED
    if seen[_BEST] == PERHAPS_SHADOW:
        return refuted + SUPPORTED
    return refuted + (SUPPORTED_EDGE if seen[_BEST] == PERHAPS_EDGE else UNSUPPORTED)


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _look(state: Bytes, ratio: Levels, size_px: Ints, column: int, row: int, like: np.float32) -> int:
    """What a camera sees around a pixel: shadow or its edge only if it is equally dark."""
    found = UNCHANGED
    for v in range(max(row - 2, 0), min(row + 3, size_px[1]), 2):
        for u in range(max(column - 2, 0), min(column + 3, size_px[0]), 2):
            if state[v, u] >= CHANGED:
                alike = state[v, u] >= PERHAPS_EDGE and abs(ratio[v, u] - like) < _SAME_RATIO
                found = max(found, state[v, u] if alike else CHANGED)
                if found == PERHAPS_SHADOW:
                    return found
    return found
