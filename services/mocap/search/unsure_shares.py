"""The share of the possible actor that cannot be told from the background, which errors mention first."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.picture import Picture
from services.mocap.errors import CertainError, TakeError
from services.mocap.types import Floats, Mask

UNTOLD = "cannot be told from the background"
REMEDY = "use more light, change the colour of the clothes or of the wall, or remove what stands before them"
_MUCH = 0.15
"""Share of the possible actor pixels: an arm is about a tenth, a leg a fifth."""
_CRUMB_SHARE = 0.02
"""Share of the largest piece below which another piece does not belong to the actor."""
_SMALLEST_SHARE = 0.002
"""Share of a picture; less than that is not a person."""
_BLOB_PX = 3
"""A narrower unsure area is a rim, as in every matte, and hides nothing."""


def may_be_actor(silhouette: Mask, possible: Mask) -> Mask:
    """The pieces (H, W) of possible pixels that contain certain ones, else the largest; without small pieces.

    Empty if all that is too small for a person.
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
    """The unsure pixels (H, W) without rims between actor and background and without specks."""
    square = np.ones((_BLOB_PX, _BLOB_PX), np.uint8)
    blobs: Mask = cv2.morphologyEx(unsure.astype(np.uint8), cv2.MORPH_OPEN, square) > 0
    return blobs


def names_or_numbers(names: Sequence[str], n_cameras: int) -> list[str]:
    """The cameras' names for sentences: as they are given, or else by number."""
    return list(names) or [f"camera {c + 1} of {n_cameras}" for c in range(n_cameras)]


@dataclass(frozen=True, eq=False)
class UnsureShares:
    """Measures unsure areas of a frame that causes an error."""

    silhouettes: Mask
    """(C, H, W) what is surely actor."""
    possible: Mask
    """(C, H, W) what may be."""
    names: Sequence[str]
    """Of the cameras."""

    @classmethod
    def of_picture(cls, picture: Picture, rig: Rig, names: Sequence[str]) -> "UnsureShares":
        """Those of a whole frame; names: as names_or_numbers takes them."""
        masks = unpack(picture.silhouettes, rig.n_cameras)
        possible = masks if picture.unsure is None else masks | unpack(picture.unsure, rig.n_cameras)
        return cls(masks, possible, names_or_numbers(names, rig.n_cameras))

    @cached_property
    def shares(self) -> Floats:
        """(C,) the unsure share of the possible actor in each camera, without rims."""
        shares = np.zeros(len(self.silhouettes))
        for c, (sure, possible) in enumerate(zip(self.silhouettes, self.possible, strict=True)):
            actor = may_be_actor(sure, possible)
            unsure = actor & without_rims(possible & ~sure)
            shares[c] = unsure.sum() / max(float(actor.sum()), 1.0)
        return shares

    def before(self, sentence: str, cameras: Sequence[int] | None = None) -> str:
        """A sentence about an error, after a sentence about unsure areas if there are large ones.

        cameras: the cameras of the error, by default all.
        """
        unsure = [c for c in range(len(self.names)) if self.shares[c] > _MUCH]
        unsure = unsure if cameras is None else [c for c in unsure if c in cameras]
        if not unsure:
            return sentence
        first, *others = unsure
        parts = [f"{self.shares[first]:.0%} of the possible actor in {self.names[first]}"]
        parts += [f"{self.shares[c]:.0%} in {self.names[c]}" for c in others]
        return f"silhouettes: {', '.join(parts)} {UNTOLD}: {REMEDY}; if this is not the cause: {sentence}"

    @contextmanager
    def blamed_first(self) -> Iterator[None]:
        """Make a TakeError of the block mention unsure areas first, unless its reason is certain."""
        try:
            yield
        except CertainError:
            raise
        except TakeError as problem:
            raise type(problem)(self.before(str(problem))) from None
