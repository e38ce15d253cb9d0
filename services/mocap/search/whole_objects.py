"""The whole of an object that hides the actor from a camera, where some of it is known.

Where nobody was behind it yet, silhouettes that are empty there would count against a leg that is.
"""

import cv2
import numpy as np
from scipy import ndimage

from services.mocap.types import Bytes, Ints, Mask

_BIN_LEVELS = 8
"""Colours are compared in cubes of as many levels of CIELAB, each with those around it."""
_LEAST_COLOUR = 0.02
"""Share of the known part that a colour must have to be one of the object's."""
_LEAST_PART = 0.05
"""Share of the known part that must lie in a connected piece of these colours."""
_MOST_SEEN = 0.05
"""Share of a piece in front of which the actor may have been seen; more is wall or floor in these colours."""
_MOST_OF_PICTURE = 0.5
"""A larger piece is the room."""


def whole_object(known: Mask, stage_bgr: Bytes, n_seen: Ints) -> Mask:
    """The pixels (h, w) of an object that is known to be in some of them, by its colours in a picture of the
    empty stage (h, w, 3).

    n_seen: (h, w) in how many frames the actor may be in a pixel.
    """
    bins = cv2.cvtColor(stage_bgr, cv2.COLOR_BGR2LAB) // _BIN_LEVELS
    counts = np.zeros((256 // _BIN_LEVELS,) * 3, np.int64)
    np.add.at(counts, tuple(bins[known].T), 1)
    own = ndimage.binary_dilation(counts >= _LEAST_COLOUR * known.sum(), np.ones((3, 3, 3)))
    alike = own[tuple(np.moveaxis(bins, 2, 0))]
    whole, (n_pieces, pieces) = np.zeros_like(known), cv2.connectedComponents(alike.view(np.uint8))
    for piece in (pieces == k for k in range(1, n_pieces)):
        holds_known = (piece & known).sum() >= _LEAST_PART * known.sum()
        if holds_known and piece.mean() <= _MOST_OF_PICTURE and (n_seen[piece] > 1).mean() <= _MOST_SEEN:
            whole |= piece
    return whole
