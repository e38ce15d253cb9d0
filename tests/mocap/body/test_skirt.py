"""A skirt is one more closed surface of the pelvis, and nothing else."""

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import SEGMENT_INDEX, SEGMENT_NAMES
from services.mocap.body.skirt import Skirt
from services.mocap.body.surface import is_closed, volume_m3

PELVIS = SEGMENT_INDEX["pelvis"]


@pytest.mark.parametrize(("length", "flare"), [(0.05, 0.0), (0.3, 0.03), (0.5, 0.2)])
def test_only_the_pelvis_gets_a_surface_down_to_the_hem(length: float, flare: float) -> None:
    bare = build_body(Actor(height=1.6))
    dressed = build_body(Actor(height=1.6).wearing(Skirt(length=length, flare=flare)))
    np.testing.assert_array_equal(dressed.offsets_m, bare.offsets_m)
    for s, name in enumerate(SEGMENT_NAMES):
        kept = len(bare.vertices_m[s])
        np.testing.assert_array_equal(dressed.vertices_m[s][:kept], bare.vertices_m[s])
        assert len(dressed.vertices_m[s]) == kept or name == "pelvis"
    cone_m = dressed.vertices_m[PELVIS][len(bare.vertices_m[PELVIS]) :]
    cone_faces = dressed.faces[PELVIS][len(bare.faces[PELVIS]) :] - len(bare.vertices_m[PELVIS])
    assert is_closed(cone_faces)
    assert volume_m3(cone_m, cone_faces) > 0
    assert cone_m[:, 2].min() == pytest.approx(-1.6 * length)
    at_hips = np.abs(bare.vertices_m[PELVIS][:, 2]) < 0.02
    beyond_m = cone_m[:, 1].max() - bare.vertices_m[PELVIS][at_hips, 1].max()
    assert beyond_m == pytest.approx(1.6 * flare, abs=0.025)


def test_shape_and_bones_stretch_it_with_the_pelvis() -> None:
    skirt = Skirt(length=0.3, flare=0.05)
    narrow, wide = (
        build_body(Actor(height=1.7, profiles={"pelvis": {"width": (w,)}}, skirt=skirt)) for w in (1.0, 1.2)
    )
    np.testing.assert_allclose(wide.vertices_m[PELVIS][:, 1], 1.2 * narrow.vertices_m[PELVIS][:, 1])
    np.testing.assert_array_equal(wide.offsets_m, narrow.offsets_m)
