"""Some of many, evenly spread."""

import numpy as np

from services.mocap.types import Ints


def evenly(n_points: int, at_most: int) -> Ints:
    """Indices of at most so many of some points, evenly spread."""
    return np.rint(np.linspace(0, max(n_points - 1, 0), min(at_most, n_points))).astype(np.int32)
