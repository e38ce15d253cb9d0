"""Moving the torso while the limbs stay: held joints hardly move, limbs alone make up for it."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import DOFS, JOINT_INDEX
from services.mocap.search.chains import LIMBS, TORSO
from services.mocap.search.compensation import limbs_staying
from services.mocap.search.solve import Model
from services.mocap.types import Floats

HELD = [JOINT_INDEX[f"{s}_{j}"] for s in ("left", "right") for j in ("elbow", "wrist", "knee", "ankle")]
LIMB_DOFS = [d for limb in LIMBS.values() for d in limb.main.dofs]
# One small move of each parameter of the root: 1 mm, or 1/100 rad.
MOVES: Floats = np.eye(N_DOF)[list(TORSO.dofs)] * [
    [0.001 if DOFS[d].unit == "m" else 0.01] for d in TORSO.dofs
]


@pytest.fixture
def bent(standing: Callable[..., Floats]) -> Floats:
    """Arms and legs bent, so that they can make up for much."""
    return standing(
        shoulder_elevation=-50, elbow_flexion=50, hip_flexion=30, knee_flexion=50, root_heading=25
    )


@pytest.mark.parametrize("k", range(len(MOVES)), ids=[DOFS[d].name for d in TORSO.dofs])
def test_held_joints_move_much_less(model: Model, bent: Floats, k: int) -> None:
    compensated = limbs_staying(bent, MOVES, model.body)
    at = joint_positions(np.stack([bent, bent + MOVES[k], bent + compensated[k]]), model.body.offsets_m)[
        :, HELD
    ]
    rigidly_mm, staying_mm = 1000 * np.linalg.norm(at[1:] - at[0], axis=2).mean(axis=1)
    assert staying_mm < 0.7 * rigidly_mm


def test_only_limbs_make_up_for_it(model: Model, bent: Floats) -> None:
    compensated = limbs_staying(bent, MOVES, model.body)
    changed = np.flatnonzero((compensated != MOVES).any(axis=0))
    assert set(changed) <= set(LIMB_DOFS)
    assert np.abs(compensated[:, LIMB_DOFS]).max() < 0.1  # no spinning


def test_is_linear_in_the_moves_and_writes_to_nothing(model: Model, bent: Floats) -> None:
    pose, moves = bent.copy(), MOVES.copy()
    one = limbs_staying(pose, moves, model.body)
    assert_array_equal(pose, bent)
    assert_array_equal(moves, MOVES)
    np.testing.assert_allclose(limbs_staying(bent, 3.0 * MOVES, model.body), 3.0 * one, atol=1e-12)
    np.testing.assert_allclose(limbs_staying(bent, MOVES[:2], model.body), one[:2], atol=1e-12)
    np.testing.assert_allclose(limbs_staying(bent, 0.0 * MOVES, model.body), 0.0, atol=1e-15)
