"""How pixels' values are kept.

Statistics are integers in separate planes: half the bytes of single precision, and memory bandwidth limits
the test.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Levels: TypeAlias = NDArray[np.float32]
"""Pixel values from 0 to 255 and what is computed from them; single precision, for speed."""
Steps: TypeAlias = NDArray[np.int16]
"""Fixed-point numbers."""

MEAN_STEPS = 128
"""Steps of a plate's mean per level."""
WHITENING_STEPS = 16384
"""Steps of a plate's whitening matrix per one."""
BB, GB, GG, RB, RG, RR = range(6)
"""Planes of a lower triangular or symmetric (3, 3) matrix per pixel, by row and column: blue, green, red."""
MAD_SIGMA = 1.4826
"""Standard deviation of normal noise over the median of its absolute value."""
