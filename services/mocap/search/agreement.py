"""Checks whether the cameras' silhouettes meet in space, and finds the camera that disagrees with the others.

The visual hull of consistent silhouettes covers each of them when it is projected. A wrongly calibrated
camera carves away what the others see; without it, the others' hull covers their silhouettes.
"""

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.search.hull import (
    MIN_CAMERAS,
    cube_about,
    in_hull,
    looked_at,
    meeting_point,
    most_missed,
    pieces_of,
    stacked,
)
from services.mocap.types import Bytes, Floats, Ints, Mask

WELL_FILLED = 0.9
"""Share of the silhouettes; if a hull covers less, choices without one or two cameras are tried."""
AGREEING_SHARE = 0.7
"""Share of the silhouettes that a hull must cover: errors of segmentation leave more, wrong cameras less."""
_VOXEL_M = 0.06
_REACH_M = 2.4
_MOST_LEFT_OUT = 2
_MORE_LEFT_OUT, _FOR_MORE = 3, range(8, 11)
"""With so many cameras three may be left out, if the hull covers all silhouettes without them, but without no
fewer: the same furniture hides the actor from them. With more cameras, one of every eight may miss a point of
the hull anyway (most_missed)."""
_ALL_FILLED = 0.995
"""Share of the silhouettes that counts as all."""
_DECISIVE = 0.1
"""How much more one choice of cameras must cover than every other choice, to be decided."""
_DECISIVE_OF_FOUR, _DECISIVE_RATIO = 0.05, 3.0
"""With four cameras this smaller margin is enough if every other choice leaves this many times as much
uncovered: three cameras, one of them wrong, may still cover most of their silhouettes."""
_CUT_SHARE, _DECISIVE_OF_CUT = 0.1, 0.02
"""Where further pieces of the hull cover more than this share of the silhouettes, something may hide part of
the actor from a camera; it is the one without which the hull is whole and covers this much more."""
_FEWEST_FOR_POST, _LEAST_PART = 6, 0.2
"""A post hides little of the actor but may cut the picture of one camera in two. With so many cameras, the
camera is left out if the hull is whole only without it, and if no other camera sees two parts, the smaller of
at least this share of the larger: of so many cameras, most see two people apart."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """The agreement of the cameras that show a person."""

    cameras: tuple[int, ...]
    odd: tuple[int, ...]
    """Cameras that disagree with all others."""
    filled: float
    """The share of the other cameras' silhouettes that their hull covers, on average."""
    people: tuple[tuple[float, Floats], ...]
    """The share of the silhouettes that each piece of the hull which may be a person covers alone, in
    descending order, and its points (N, 3)."""
    suspects: tuple[int, ...] = ()
    """If none is odd: cameras of which one is probably wrong, because without any one of them the others
    meet."""

    @property
    def agree(self) -> bool:
        """Whether the cameras without the odd ones agree."""
        return self.filled >= AGREEING_SHARE


def find_agreement(rig: Rig, silhouettes: Mask, cameras: tuple[int, ...], possible: Mask) -> Agreement:
    """Look for the fewest cameras without which the silhouettes (C, H, W) of the others meet in space.

    cameras: at least two, those that show a person. possible (C, H, W): possible actor pixels; they enlarge
    the hull, but only the silhouettes must be covered. A camera is odd only if at least three others agree:
    if they cover much more without it, or are whole only without it. Raises TakeError if the rays do not
    meet.
    """
    space = _Space(rig, silhouettes, cameras, possible)
    best, suspects = _choice(space, cameras, ()), tuple[int, ...]()
    all_filled = False
    for n_odd in range(1, (_MORE_LEFT_OUT if len(cameras) in _FOR_MORE else _MOST_LEFT_OUT) + 1):
        is_cut = best.filled >= WELL_FILLED and space.is_cut(best.kept)
        if (best.filled >= WELL_FILLED and not is_cut) or len(cameras) - n_odd <= MIN_CAMERAS:
            break
        choices = [_choice(space, cameras, odd) for odd in combinations(cameras, n_odd)]
        choices.sort(key=lambda choice: -choice.filled)
        post = _without_post(space, cameras, choices) if is_cut and n_odd == 1 else None
        if post is not None:
            best = post
            break
        if n_odd > _MOST_LEFT_OUT:
            is_decided = choices[0].filled >= _ALL_FILLED and not all_filled
        elif is_cut:
            gain = choices[0].filled - best.filled
            is_decided = gain >= _DECISIVE_OF_CUT and not space.is_cut(choices[0].kept)
        else:
            is_decided = _is_decided(len(cameras), choices[0].filled, choices[1].filled)
        all_filled = all_filled or choices[0].filled >= _ALL_FILLED
        if is_decided:
            best, suspects = choices[0], ()
        elif n_odd == 1 and not is_cut:
            suspects = _suspects(choices)
    return Agreement(cameras, best.odd, best.filled, space.people(best.kept), suspects)


def filled_by_others(rig: Rig, silhouettes: Mask, possible: Mask) -> Floats:
    """(C,) the share of each camera's silhouette (C, H, W) of a moment that the others' hull covers.

    NaN for a camera that does not show the actor, or that alone does. possible (C, H, W): what may be actor;
    it leaves the hull room. Raises TakeError where the cameras' rays do not even come near to each other.
    """
    seen, shares = np.flatnonzero(silhouettes.any(axis=(1, 2))).tolist(), np.full(rig.n_cameras, np.nan)
    if len(seen) < MIN_CAMERAS:
        return shares
    space = _Space(rig, silhouettes, tuple(seen), possible)
    for c in seen:
        shares[c] = space.covered(c, space.hull_m(tuple(other for other in seen if other != c)))
    return shares


@dataclass(frozen=True)
class _Choice:
    odd: tuple[int, ...]
    kept: tuple[int, ...]
    """The other cameras."""
    filled: float


def _is_decided(n_cameras: int, filled: float, next_filled: float) -> bool:
    """Whether the best choice covers so much more than the next one that only it can be right."""
    margin, needed = filled - next_filled, _DECISIVE
    if n_cameras == MIN_CAMERAS + 2 and 1.0 - next_filled >= _DECISIVE_RATIO * (1.0 - filled):
        needed = _DECISIVE_OF_FOUR
    return filled >= WELL_FILLED and margin >= needed


def _without_post(space: "_Space", cameras: tuple[int, ...], choices: list[_Choice]) -> _Choice | None:
    """The choice without the only camera that sees the actor cut in two; None if there is no such camera."""
    if len(cameras) < _FEWEST_FOR_POST:
        return None
    whole = [choice for choice in choices if not space.is_cut(choice.kept)]
    in_parts = tuple(c for c in cameras if space.views[c].is_in_parts())
    return whole[0] if [choice.odd for choice in whole] == [in_parts] else None


def _suspects(choices: list[_Choice]) -> tuple[int, ...]:
    """The single cameras without which the others agree, in their order; none if it may be any."""
    likely = [c for c in choices if c.filled >= max(WELL_FILLED, choices[0].filled - _DECISIVE)]
    return tuple(sorted(c.odd[0] for c in likely)) if len(likely) < len(choices) else ()


def _choice(space: "_Space", cameras: tuple[int, ...], odd: tuple[int, ...]) -> _Choice:
    kept = tuple(c for c in cameras if c not in odd)
    return _Choice(odd, kept, space.filled(kept))


class _Space:
    """A cube of voxels, with the cameras that would carve each away."""

    def __init__(self, rig: Rig, silhouettes: Mask, cameras: tuple[int, ...], possible: Mask) -> None:
        """Look up all voxels once in the possible actor pixels of all cameras (C, H, W)."""
        centre_m = meeting_point(rig, silhouettes, list(cameras))
        self._points_m = cube_about(centre_m, _REACH_M, _VOXEL_M)
        self._looks = looked_at(rig, possible, range(rig.n_cameras), self._points_m)
        self.views = {c: _View.of(rig, silhouettes[c], c, centre_m) for c in cameras}

    def filled(self, cameras: tuple[int, ...]) -> float:
        """The share of some cameras' silhouettes that the hull of these cameras covers, on average."""
        points_m = self.hull_m(cameras)
        return float(np.mean([self.covered(c, points_m) for c in cameras]))

    def hull_m(self, cameras: tuple[int, ...]) -> Floats:
        """(N, 3) the voxels in the hull of some cameras."""
        return self._points_m[self._inside(cameras)]

    def covered(self, camera: int, points_m: Floats) -> float:
        """The share of a camera's silhouette that voxels about points (N, 3) cover."""
        return self.views[camera].share(self.views[camera].draw(points_m))

    def is_cut(self, cameras: tuple[int, ...]) -> bool:
        """Whether the hull of some cameras is in several pieces that count."""
        shares = self._piece_shares(cameras, self._pieces(cameras))
        return bool(shares.sum() - shares.max(initial=0.0) > _CUT_SHARE)

    def people(self, cameras: tuple[int, ...]) -> tuple[tuple[float, Floats], ...]:
        """The shares (_piece_shares) and the points (N, 3) of the pieces that may be a person each: those one
        above the other are one. The largest share comes first."""
        pieces = stacked(self._points_m, self._pieces(cameras))
        shares = self._piece_shares(cameras, pieces)
        order = np.argsort(-shares, kind="stable")  # a large piece of possible pixels may cover nothing
        return tuple((float(shares[n]), self._points_m[pieces == 1 + n]) for n in order)

    def _pieces(self, cameras: tuple[int, ...]) -> Ints:
        return pieces_of(self._inside(cameras, most_missed(len(cameras))), bridged=True)

    def _piece_shares(self, cameras: tuple[int, ...], pieces: Ints) -> Floats:
        """The share of some cameras' silhouettes (K,) that only this piece of their hull covers, for each
        piece.

        pieces: (N,) their numbers, from 1 on; 0 outside. In some cameras other pieces hide a piece, so this
        averages over the half of the cameras with the largest shares.
        """
        n_pieces = min(int(pieces.max(initial=0)), 3)  # further pieces are negligible
        shares = np.zeros((n_pieces, len(cameras)))
        for k, c in enumerate(cameras):
            drawn = [self.views[c].draw(self._points_m[pieces == 1 + n]) for n in range(n_pieces)]
            once = np.sum(drawn, axis=0) == 1
            shares[:, k] = [self.views[c].share(piece & once) for piece in drawn]
        return np.asarray(np.sort(shares, axis=1)[:, len(cameras) // 2 :].mean(axis=1))

    def _inside(self, cameras: tuple[int, ...], n_missed: int = 0) -> Mask:
        """The hull (N,) of some cameras, of which n_missed may miss a point."""
        in_picture, on_actor = (look[list(cameras)] for look in self._looks)
        return in_hull(in_picture, on_actor, n_missed)


@dataclass(frozen=True, eq=False)
class _View:
    """A camera's silhouette, reduced so that a voxel is about as large as a pixel."""

    P_px_world: Floats
    """(3, 4) to pixels of the small picture."""
    silhouette: Mask
    """(h, w)"""

    @classmethod
    def of(cls, rig: Rig, silhouette: Mask, camera: int, centre_m: Floats) -> "_View":
        P = rig.P_px_world[camera]
        depth_m = max(float(P[2] @ np.append(centre_m, 1.0)), 10 * _VOXEL_M)
        scale = min(1.0, depth_m / (_VOXEL_M * float(np.linalg.norm(P[0, :3]))))
        width, height = rig.sizes_px[camera]
        size = max(1, round(width * scale)), max(1, round(height * scale))
        small = cv2.resize(silhouette[:height, :width].astype(np.float32), size, interpolation=cv2.INTER_AREA)
        return cls(np.diag([size[0] / width, size[1] / height, 1.0]) @ P, small >= 0.5)

    def draw(self, points_m: Floats) -> Mask:
        """The picture (h, w) of voxels about points (N, 3)."""
        height, width = self.silhouette.shape
        homogeneous = points_m @ self.P_px_world[:, :3].T + self.P_px_world[:, 3]
        homogeneous = homogeneous[homogeneous[:, 2] > _VOXEL_M]
        pixel = np.rint(homogeneous[:, :2] / homogeneous[:, 2:]).astype(np.int64)
        pixel = pixel[np.all((pixel >= 0) & (pixel < (width, height)), axis=1)]
        drawn: Bytes = np.zeros((height, width), np.uint8)
        drawn[pixel[:, 1], pixel[:, 0]] = 1
        wide: Mask = cv2.dilate(drawn, np.ones((3, 3), np.uint8)) > 0
        return wide

    def is_in_parts(self) -> bool:
        """Whether the silhouette has a second part that counts."""
        statistics = cv2.connectedComponentsWithStats(self.silhouette.astype(np.uint8))[2]
        areas_px = np.sort(statistics[1:, cv2.CC_STAT_AREA])[::-1]
        return len(areas_px) > 1 and bool(areas_px[1] >= _LEAST_PART * areas_px[0])

    def share(self, drawn: Mask) -> float:
        """The share of the silhouette that a picture (h, w) covers."""
        return float((drawn & self.silhouette).sum() / max(int(self.silhouette.sum()), 1))
