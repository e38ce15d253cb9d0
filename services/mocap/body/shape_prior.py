"""The prior of body shapes: a normal distribution over the shape space.

Stout people are stout everywhere, and neighbouring places on a limb or the trunk change together; bones vary
independently, except that those of a limb, and of both limbs, are correlated.
"""

import numpy as np

from services.mocap.body.shape_space import DEVIATIONS, INDEX
from services.mocap.types import Floats

_STOUTNESS = 0.5
"""Share of a girth's variance that all girths have in common."""
_CHAINS = ("trunk_width", "trunk_depth", "arm_girth", "leg_girth")
_NECK = "neck_girth"
_HIPS = ("trunk_width_hip", "trunk_depth_hip", "leg_girth_hip")
_HIPS_ALIKE = 0.25
"""Share of the variance at the hips that pelvis and thighs have in common besides stoutness."""
_CHAIN_REACH = 1.5
"""Controls along a chain over which the correlation falls to 1/e."""
_LIMB_BONES = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
_MEAN_FACTORS = {"upper_arm": 0.97, "forearm": 1.01, "thigh": 1.02, "shank": 1.005, "foot_depth": 1.35}
"""People's mean measures on those of the generic body, over stature. Arms: women and men in de Leva 1996
(J. Biomechanics 29(9)), from joint centre to joint centre. Legs: heights of trochanter, epicondyle and
malleolus in the 2012 US Army survey. Depth of the foot: soles of 1 to 4 cm under it."""
_LONG_LIMBS = 0.4
"""Share of a limb bone's variance that all limb bones have in common."""


def _correlation() -> Floats:
    """(n, n) as a sum of non-negative parts, so that it is a valid correlation matrix."""
    names = list(INDEX)
    chain_of = {name: next((c for c in _CHAINS if name.startswith(c)), "") for name in names}
    stout = np.array([bool(chain_of[name]) or name == _NECK for name in names], float)
    limbs = np.array([name in _LIMB_BONES for name in names], float)
    places = np.arange(len(names))
    near = np.exp(-np.abs(places[:, None] - places) / _CHAIN_REACH)
    same = np.array([[bool(chain_of[a]) and chain_of[a] == chain_of[b] for b in names] for a in names])
    own = np.where(same, near, np.eye(len(names)))
    hips = np.array([name in _HIPS for name in names], float)
    groups = ((_STOUTNESS, stout), (_LONG_LIMBS, limbs), (_HIPS_ALIKE, hips))
    shared = sum((share * np.outer(group, group) for share, group in groups), np.zeros(near.shape))
    left = np.sqrt(1.0 - np.diag(shared))
    correlation: Floats = shared + own * np.outer(left, left)
    return correlation


COVARIANCE: Floats = _correlation() * np.outer(DEVIATIONS, DEVIATIONS)
"""(n, n) of the shape vectors of people."""
MEAN: Floats = np.log([_MEAN_FACTORS.get(name, 1.0) for name in INDEX])
"""(n,) of the shape vectors of people; zero is the generic body."""
