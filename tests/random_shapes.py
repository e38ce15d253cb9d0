"""Random body shapes for tests, distributed as people's are."""

import numpy as np

from services.mocap.body.shape_space import INDEX, PARAMETERS, body_of, clip_to_bounds
from services.mocap.fit.priors import COVARIANCE
from services.mocap.types import Floats

_MOST_DEVIATIONS = 2.0


def random_shape(rng: np.random.Generator, low_m: float = 1.5, high_m: float = 2.0) -> Floats:
    """A random shape vector (n,) from the prior, with a height uniform between low_m and high_m."""
    z = np.clip(rng.standard_normal(len(PARAMETERS)), -_MOST_DEVIATIONS, _MOST_DEVIATIONS)
    x = clip_to_bounds(np.linalg.cholesky(COVARIANCE) @ z)
    height_m = rng.uniform(low_m, high_m)
    x[INDEX["height"]] += np.log(height_m / body_of(x).standing_height_m)
    return x
