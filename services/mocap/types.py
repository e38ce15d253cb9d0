"""Array types by element; shapes, units and frames are in the docstrings of the functions."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int32]
Bytes: TypeAlias = NDArray[np.uint8]
"""Images (…, 3) in BGR order, and bit-plane buffers."""
Mask: TypeAlias = NDArray[np.bool_]
Trimap: TypeAlias = NDArray[np.uint8]
"""A silhouette (H, W) of three states, each pixel one of those below."""

BACKGROUND, UNSURE, ACTOR = 0, 128, 255
"""Pixels of a trimap; unsure ones are not counted."""
