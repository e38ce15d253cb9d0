import numpy as np
import pytest

from services.mocap.take.tables import REFERENCE_JOINTS
from services.recorder.run_report import LOST_LIMB_MM, joint_errors


def test_offsets_come_back_as_errors() -> None:
    rng = np.random.default_rng(1)
    reference_m = rng.normal(size=(40, 15, 3))
    directions = rng.normal(size=(40, 15, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    errors_mm = rng.uniform(0.0, 190.0, size=(40, 15))
    errors = joint_errors(range(40), reference_m + directions * errors_mm[..., None] / 1000.0, reference_m)

    by_joint = errors["mean_by_joint_mm"]
    assert list(by_joint) == list(REFERENCE_JOINTS)
    np.testing.assert_allclose(list(by_joint.values()), errors_mm.mean(axis=0), rtol=1e-9)
    assert errors["frames"] == 40
    assert errors["mean_mm"] == pytest.approx(errors_mm.mean())
    assert errors["median_mm"] == pytest.approx(np.median(errors_mm))
    assert np.mean(errors_mm <= errors["p95_mm"]) == pytest.approx(0.95)
    assert errors["lost_limbs"] == []
    assert errors["frames_with_lost_limbs"] == 0


def test_lost_limbs_are_named_by_frame_and_joint() -> None:
    reference_m = np.zeros((5, 15, 3))
    estimated_m = reference_m.copy()
    wrist, ankle = REFERENCE_JOINTS.index("left_wrist"), REFERENCE_JOINTS.index("right_ankle")
    estimated_m[3, wrist] = (0.0, 0.3, 0.0)
    estimated_m[1, ankle] = (0.15, 0.15, 0.0)
    estimated_m[4, ankle] = (LOST_LIMB_MM / 1000.0, 0.0, 0.0)  # not above the threshold
    errors = joint_errors(range(10, 15), estimated_m, reference_m)
    assert errors["lost_limbs"] == [
        {"frame": 11, "joint": "right_ankle"},
        {"frame": 13, "joint": "left_wrist"},
    ]
    assert errors["frames_with_lost_limbs"] == 2
