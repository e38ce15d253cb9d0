"""Array types that only the compiled code of the energy uses."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Indices: TypeAlias = NDArray[np.uint32]
"""Unsigned, so that compiled code does not test every index for being counted from the end."""
Shorts: TypeAlias = NDArray[np.int16]
Singles: TypeAlias = NDArray[np.float32]
Words: TypeAlias = NDArray[np.uint64]
