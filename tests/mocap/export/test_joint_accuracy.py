import numpy as np
import pytest

from services.mocap.export.joint_accuracy import LOST_LIMB_MM, joint_errors
from services.mocap.take.tables import REFERENCE_JOINTS


def test_offsets_come_back_as_errors() -> None:
    rng = np.random.default_rng(1)
    reference_m = rng.normal(size=(40, 15, 3))
    directions = rng.normal(size=(40, 15, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    errors_mm = rng.uniform(0.0, 190.0, size=(40, 15))
    errors = joint_errors(reference_m + directions * errors_mm[..., None] / 1000.0, reference_m)

    assert list(errors.mean_by_joint_mm) == list(REFERENCE_JOINTS)
    np.testing.assert_allclose(list(errors.mean_by_joint_mm.values()), errors_mm.mean(axis=0), rtol=1e-9)
    assert errors.mean_mm == pytest.approx(errors_mm.mean())
    assert errors.median_mm == pytest.approx(np.median(errors_mm))
    assert np.mean(errors_mm <= errors.p95_mm) == pytest.approx(0.95)
    assert errors.lost_limbs == []


def test_lost_limbs_are_named_by_frame_and_joint() -> None:
    reference_m = np.zeros((5, 15, 3))
    estimated_m = reference_m.copy()
    wrist, ankle = REFERENCE_JOINTS.index("left_wrist"), REFERENCE_JOINTS.index("right_ankle")
    estimated_m[3, wrist] = (0.0, 0.3, 0.0)
    estimated_m[1, ankle] = (0.15, 0.15, 0.0)
    estimated_m[4, ankle] = (LOST_LIMB_MM / 1000.0, 0.0, 0.0)  # not above the threshold
    assert joint_errors(estimated_m, reference_m).lost_limbs == [(1, "right_ankle"), (3, "left_wrist")]


@pytest.mark.parametrize(
    ("estimated_m", "message"),
    [
        (np.zeros((3, 17, 3)), r"^estimated_m: expected shape \(N, 15, 3\), got \(3, 17, 3\)$"),
        (np.zeros((0, 15, 3)), r"^estimated_m: expected shape"),
        (np.zeros((2, 15, 3)), "^estimated_m has 2 frames, reference_m 3$"),
        (np.full((3, 15, 3), np.nan), "^estimated_m: expected finite numbers$"),
    ],
)
def test_refuses_what_it_cannot_compare(estimated_m: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        joint_errors(estimated_m, np.zeros((3, 15, 3)))
