"""The viewpoint has everything in view, and nothing to spare."""

import numpy as np
import pytest

from services.viewer.viewpoint import FOV_RAD, viewpoint_of


@pytest.mark.parametrize("aspect", [0.6, 1.0, 2.5])
@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0])
def test_all_points_are_in_view(aspect: float, heading: float) -> None:
    rng = np.random.default_rng(5)
    points_m = rng.uniform((-3, -2, 0), (4, 5, 2.5), (40, 3))
    eye_m, look_at_m = viewpoint_of(points_m, 0.2, heading, aspect)
    forward = look_at_m - eye_m
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    offsets_m = points_m - eye_m
    depth_m = offsets_m @ forward
    tan_up = np.tan(0.5 * FOV_RAD)
    across = (np.abs(offsets_m @ right) + 0.2) / (depth_m * tan_up * aspect)
    upward = (np.abs(offsets_m @ np.cross(right, forward)) + 0.2) / (depth_m * tan_up)
    assert depth_m.min() > 0
    assert 0.8 < max(across.max(), upward.max()) < 1.0
