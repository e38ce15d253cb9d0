"""How much of each camera's silhouette the others' hull covers."""

import numpy as np
import pytest

from services.mocap.camera.rig import Rig
from services.mocap.search.agreement import filled_by_others
from services.mocap.synth.studio import studio_cameras


@pytest.mark.parametrize("n_seen", [0, 1])
def test_nothing_is_known_where_fewer_than_two_cameras_show_somebody(n_seen: int) -> None:
    rig = Rig.of(studio_cameras(3))
    silhouettes = np.zeros((3, *rig.shape_px), bool)
    silhouettes[:n_seen, 40:160, 100:140] = True
    assert np.isnan(filled_by_others(rig, silhouettes, silhouettes)).all()
