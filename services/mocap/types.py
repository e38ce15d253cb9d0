"""Array types by element; shapes, units and frames are in the docstrings of the functions."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int32]
Bytes: TypeAlias = NDArray[np.uint8]
"""Images (…, 3) in BGR order, and bit-plane buffers."""
Indices: TypeAlias = NDArray[np.uint32]
"""Unsigned, so that compiled code does not test every index for being counted from the end."""
Shorts: TypeAlias = NDArray[np.int16]
Longs: TypeAlias = NDArray[np.int64]
Singles: TypeAlias = NDArray[np.float32]
Words: TypeAlias = NDArray[np.uint64]
Mask: TypeAlias = NDArray[np.bool_]
Trimap: TypeAlias = NDArray[np.uint8]
"""A silhouette (H, W) of three states, each pixel one of those below."""

BACKGROUND, UNSURE, ACTOR = 0, 128, 255
"""Pixels of a trimap; unsure ones are not counted."""
