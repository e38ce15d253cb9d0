"""What tests of kinematics try: a body's offsets, and any pose within the joint limits."""

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import JOINTS, LOWER, UPPER
from services.mocap.types import Floats

OFFSETS_M: Floats = 1.75 * np.array([joint.offset_heights for joint in JOINTS])


def _all_poses() -> st.SearchStrategy[Floats]:
    """Poses (D,) within the limits, the root anywhere."""
    shares = arrays(np.float64, N_DOF, elements=st.floats(0.0, 1.0, width=32))
    lower, upper = np.maximum(LOWER, -7.0), np.minimum(UPPER, 7.0)
    return shares.map(lambda share: lower + share * (upper - lower))


POSES = _all_poses()
FEW = settings(max_examples=60, deadline=None)
