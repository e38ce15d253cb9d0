"""How much of what may be the actor cannot be told from the background: said before all else is blamed."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from services.mocap.errors import TakeError
from services.mocap.types import Floats, Mask

UNTOLD = "cannot be told from the background"
REMEDY = "light the stage more, or choose clothes or a wall behind of another colour"
_MUCH = 0.15
"""Of what may be the actor: an arm is about a tenth of that, a leg a fifth."""
_CRUMB_SHARE = 0.02
"""Of the largest piece, below which another one is none of the actor's."""
_SMALLEST_SHARE = 0.002
"""Of a picture; less than that is nobody."""
_BLOB_PX = 3
"""What is unsure over fewer pixels across is a rim, as every matte has it, and hides nothing."""


def may_be_actor(silhouette: Mask, possible: Mask) -> Mask:
    """The pieces (H, W) of what is possible that hold something sure, or else the largest; without crumbs.

    Nothing where all that is too small for anybody.
    """
    n_pieces, pieces, statistics, _ = cv2.connectedComponentsWithStats(possible.astype(np.uint8))
    areas_px = statistics[:, cv2.CC_STAT_AREA].copy()
    areas_px[0] = 0  # the background
    sure_px = np.bincount(pieces[silhouette & possible], minlength=n_pieces)
    if sure_px.any():
        areas_px[sure_px == 0] = 0
        is_kept = areas_px > _CRUMB_SHARE * areas_px.max()
    else:
        is_kept = (np.arange(n_pieces) == areas_px.argmax()) & (areas_px > 0)
    kept: Mask = (is_kept & (areas_px[is_kept].sum() > _SMALLEST_SHARE * pieces.size))[pieces]
    return kept


def without_rims(unsure: Mask) -> Mask:
    """What is unsure (H, W) and more than a rim between actor and background, or a speck."""
    square = np.ones((_BLOB_PX, _BLOB_PX), np.uint8)
    blobs: Mask = cv2.morphologyEx(unsure.astype(np.uint8), cv2.MORPH_OPEN, square) > 0
    return blobs


def names_or_numbers(names: Sequence[str], n_cameras: int) -> list[str]:
    """The cameras' names for sentences: as they are given, or else by number."""
    return list(names) or [f"camera {c + 1} of {n_cameras}" for c in range(n_cameras)]


@dataclass(frozen=True, eq=False)
class UnsureShares:
    """Looks at what is unsure where a frame makes no sense."""

    silhouettes: Mask
    """(C, H, W) what is surely actor."""
    possible: Mask
    """(C, H, W) what may be."""
    names: Sequence[str]
    """Of the cameras."""

    @cached_property
    def shares(self) -> Floats:
        """(C,) how much of what may be the actor is unsure in each camera, rims aside."""
        shares = np.zeros(len(self.silhouettes))
        for c, (sure, possible) in enumerate(zip(self.silhouettes, self.possible, strict=True)):
            actor = may_be_actor(sure, possible)
            unsure = actor & without_rims(possible & ~sure)
            shares[c] = unsure.sum() / max(float(actor.sum()), 1.0)
        return shares

    def before(self, sentence: str, cameras: Sequence[int] | None = None) -> str:
        """A sentence of what seems to be wrong, after another one where much is unsure.

        cameras: those that it is about, by default all.
        """
        unsure = [c for c in range(len(self.names)) if self.shares[c] > _MUCH]
        unsure = unsure if cameras is None else [c for c in unsure if c in cameras]
        if not unsure:
            return sentence
        first, *others = unsure
        parts = [f"{self.shares[first]:.0%} of what may be the actor in {self.names[first]}"]
        parts += [f"{self.shares[c]:.0%} in {self.names[c]}" for c in others]
        return f"silhouettes: {', '.join(parts)} {UNTOLD}: {REMEDY}; if that is not it: {sentence}"

    @contextmanager
    def blamed_first(self) -> Iterator[None]:
        """Let a TakeError of the block say what is unsure before what it says itself."""
        try:
            yield
        except TakeError as problem:
            raise TakeError(self.before(str(problem))) from None
