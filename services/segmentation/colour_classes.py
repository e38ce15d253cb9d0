"""Colour classes: what each part of an actor looks like in each camera, learnt from a tracked take.

Every quarter of every segment has a histogram of the colours that it shows in each camera. Pieces with
similar histograms make one class: skin, hair, shirt, trousers, shoes. Classes that look too much alike are
merged. A pixel of the actor then has the class whose colours are clearly likelier than the others', or none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.special import rel_entr

from services.mocap.body.colours import COLOURED, MOST_CLASSES, QUARTERS
from services.mocap.take.fit_record import COLOUR_BINS
from services.mocap.types import Bytes, Floats, Ints, Mask, Singles
from services.segmentation.cleanup import box_of

_SMOOTH_BINS = (1.2, 0.8, 0.8)
"""Standard deviation by which histograms are smoothed."""
_LEAST_PX = 150
"""A piece that showed fewer pixels, over all cameras and frames, has no class."""
_SAME = 0.35
"""Pieces make one class where one minus the Bhattacharyya coefficient of their histograms is less."""
_CLEARLY = 3.0
"""How many times likelier than any other class a colour must be to have a class."""
_LEAST_DENSITY = 1e-5
"""A colour that every class has more seldom has no class."""
_LEAST_SHARE = 0.6
"""A piece has a class if so many of its pixels with any class have that one."""
_ROUNDS = 3
"""Of sorting pieces into classes and learning the classes' colours from what is sorted."""
N_PIECES = len(COLOURED) * QUARTERS
PIECES: Bytes = np.arange(1, 1 + N_PIECES, dtype=np.uint8).reshape(len(COLOURED), QUARTERS)
"""(S + 5, QUARTERS) the number of each piece, from 1 on, as a table for ColourPainter.painted."""


def classes_of(image_bgr: Bytes, table: Bytes) -> Bytes:
    """(H, W) the class of every pixel of a picture (H, W, 3) by a camera's colour table (COLOUR_BINS)."""
    return table.ravel()[_bins_of(image_bgr)]


def _bins_of(image_bgr: Bytes) -> NDArray[np.int32]:
    """(H, W) numbers of bins, of the picture slightly blurred, as noise is larger than colours differ."""
    lab = cv2.cvtColor(cv2.GaussianBlur(image_bgr, (3, 3), 0), cv2.COLOR_BGR2LAB).astype(np.int32)
    chroma = np.clip((lab[..., 1:] - 128 >> 2) + 16, 0, 31)
    return np.asarray((lab[..., 0] >> 4) * 1024 + chroma[..., 0] * 32 + chroma[..., 1], np.int32)


@dataclass(frozen=True, eq=False)
class ColourClasses:
    """The classes of one actor in some cameras."""

    colours: Mapping[str, tuple[int, ...]]
    """As in Actor.colours."""
    tables: Bytes
    """(C, *COLOUR_BINS) by camera the class of each colour, 0 for none."""


class ColourLearner:
    """Collects the colours of an actor's pieces from pictures in which poses are known."""

    def __init__(self, n_cameras: int) -> None:
        self._counts: Ints = np.zeros((n_cameras, N_PIECES, int(np.prod(COLOUR_BINS))), np.int32)

    def add(self, camera: int, image_bgr: Bytes, pieces: Bytes, actor: Mask) -> None:
        """Add a picture (H, W, 3) without lens distortion; pieces (H, W): which of PIECES the body shows, 0
        for none; actor (H, W): what is surely actor. Pixels near another segment or the outline are left
        out."""
        box = box_of(actor & (pieces > 0), 0)
        if box is None:
            return
        image_bgr, pieces, actor = image_bgr[box], pieces[box], actor[box]
        segments = np.where(actor & (pieces > 0), 1 + (pieces.astype(np.int32) - 1) // QUARTERS, 0)
        kernel, numbers = np.ones((3, 3), np.uint8), segments.astype(np.uint8)
        inside = (numbers > 0) & (cv2.erode(numbers, kernel) == cv2.dilate(numbers, kernel))
        of_pieces = self._counts[camera]
        np.add.at(of_pieces, (pieces[inside].astype(np.int32) - 1, _bins_of(image_bgr)[inside]), 1)

    def conclude(self) -> ColourClasses | None:
        """The classes; None if the actor shows one colour only."""
        known = np.flatnonzero(self._counts.sum(axis=(0, 2)) >= _LEAST_PX)
        if len(known) < 2:
            return None
        counts = self._counts[:, known].astype(np.float32)
        smooth = gaussian_filter(counts.reshape(*counts.shape[:2], *COLOUR_BINS), (0, 0, *_SMOOTH_BINS))
        smooth = smooth.reshape(counts.shape)
        used = smooth.any(axis=(0, 1))  # of all colours, people show a few
        counts, smooth = counts[..., used], smooth[..., used]
        classes: Ints = np.zeros(len(known), np.int32)
        for number, group in enumerate(_merged(_grouped(_densities(smooth)), counts, smooth), 1):
            classes[group] = number
        for _ in range(_ROUNDS):
            numbers = np.unique(classes[classes > 0])
            names = np.concatenate([[0], numbers]).astype(np.uint8)
            tables = names[_clear(_sums(smooth, [classes == k for k in numbers]))]
            classes = _sorted_into(counts, tables)
            if len(np.unique(classes[classes > 0])) < 2:
                return None
        of_pieces: Ints = np.zeros(N_PIECES, np.int32)
        of_pieces[known] = classes
        of_surfaces = of_pieces.reshape(PIECES.shape)
        colours = {
            name: tuple(of_surfaces[s].tolist())
            for s, name in reversed(list(enumerate(COLOURED)))
            if of_surfaces[s].any()
        }
        of_bins = np.zeros((len(tables), len(used)), np.uint8)
        of_bins[:, used] = tables
        return ColourClasses(dict(sorted(colours.items())), of_bins.reshape(-1, *COLOUR_BINS))


def _densities(counts: Singles) -> Singles:
    """Histograms (…, bins) as densities; zero where nothing was counted."""
    return np.asarray(counts / np.maximum(counts.sum(axis=-1, keepdims=True), 1e-9), np.float32)


def _sums(counts: Singles, groups: Sequence[Sequence[int] | Mask]) -> Singles:
    """(C, G, bins) of each group of pieces, from (C, K, bins)."""
    return np.stack([counts[:, group].sum(axis=1) for group in groups], axis=1)


def _clear(counts: Singles) -> Ints:
    """(C, bins) the number from 1 on of the group for which a colour clearly speaks, 0 for none; counts
    (C, G, bins): of the groups' colours, smoothed."""
    density = _densities(counts)
    ranked = np.sort(density, axis=1)
    is_clear = ranked[:, -1] > _LEAST_DENSITY
    if density.shape[1] > 1:
        is_clear &= ranked[:, -1] > _CLEARLY * ranked[:, -2]
    return np.where(is_clear, 1 + density.argmax(axis=1), 0).astype(np.int32)


def _grouped(densities: Singles) -> list[list[int]]:
    """Pieces with densities (C, K, bins), put into at most MOST_CLASSES groups of similar ones, the most
    similar first."""
    groups = [[k] for k in range(densities.shape[1])]
    roots = np.sqrt(densities)
    apart = _apart(roots, roots)
    np.fill_diagonal(apart, np.inf)
    while len(groups) > 1:
        i, j = sorted(divmod(int(apart.argmin()), len(groups)))
        if apart[i, j] > _SAME and len(groups) <= MOST_CLASSES:
            break
        groups[i] += groups.pop(j)
        roots[:, i] = np.sqrt(densities[:, groups[i]].mean(axis=1))
        roots, apart = np.delete(roots, j, axis=1), np.delete(np.delete(apart, j, axis=0), j, axis=1)
        apart[i] = apart[:, i] = _apart(roots, roots[:, i, None])[:, 0]
        apart[i, i] = np.inf
    return groups


def _merged(groups: list[list[int]], counts: Singles, smooth: Singles) -> list[list[int]]:
    """The groups, two of them made one as long as a pixel's class then tells more.

    Where two groups look alike, their colours speak clearly for neither of them, so that most pixels of both
    have no class. counts, smooth (C, K, bins): of all pieces, as they are and smoothed.
    """

    def joined(i: int, j: int) -> list[list[int]]:
        return [*(group for k, group in enumerate(groups) if k not in (i, j)), groups[i] + groups[j]]

    told = _told(_sums(counts, groups), _sums(smooth, groups))
    while len(groups) > 2:
        tries = [joined(i, j) for i, j in combinations(range(len(groups)), 2)]
        each = [_told(_sums(counts, joint), _sums(smooth, joint)) for joint in tries]
        if max(each) <= told:
            break
        told, groups = max(each), tries[int(np.argmax(each))]
    return groups


def _told(counts: Singles, smooth: Singles) -> float:
    """The information that a pixel's class, where it has one, gives about its group: their mutual information
    in nats, without the pixels that have none. counts, smooth (C, G, bins)."""
    n_groups = counts.shape[1]
    tables = _clear(smooth)
    read = np.array(
        [np.where(tables[:, None] == k, counts, 0.0).sum(axis=(0, 2)) for k in range(1, 1 + n_groups)]
    )
    shares, of_group = read.T / counts.sum(), counts.sum(axis=(0, 2)) / counts.sum()
    return float(rel_entr(shares, np.outer(of_group, shares.sum(axis=0))).sum())


def _apart(one: Singles, other: Singles) -> Floats:
    """(K, J) one minus the Bhattacharyya coefficients of pieces, mean over the cameras that show both; one
    (C, K, bins), other (C, J, bins): roots of their densities."""
    shown_one, shown_other = (roots.any(axis=2).astype(np.float32) for roots in (one, other))
    n_both = np.einsum("ck,cj->kj", shown_one, shown_other)
    common = (one @ other.transpose(0, 2, 1)).sum(axis=0)
    return np.where(n_both > 0, 1.0 - common / np.maximum(n_both, 1), 1.0).astype(np.float64)


def _sorted_into(counts: Singles, tables: Bytes) -> Ints:
    """(K,) the class that most pixels of each piece have, 0 where there is none; counts (C, K, bins),
    tables (C, bins)."""
    votes = np.zeros((counts.shape[1], 1 + MOST_CLASSES))
    for of_camera, table in zip(counts, tables, strict=True):
        for k in range(1, 1 + MOST_CLASSES):
            votes[:, k] += of_camera[:, table == k].sum(axis=1)
    best = votes.argmax(axis=1)
    is_clear = votes.max(axis=1) > _LEAST_SHARE * np.maximum(votes.sum(axis=1), 1.0)
    return np.where(is_clear, best, 0).astype(np.int32)
