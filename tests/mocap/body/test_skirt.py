"""A skirt is cloth besides the segments, and nothing else."""

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.garments import Skirt
from services.mocap.body.skeleton import SEGMENT_INDEX, SEGMENT_NAMES
from services.mocap.body.surface import is_closed, volume_m3

PELVIS = SEGMENT_INDEX["pelvis"]


@pytest.mark.parametrize(("length", "flare"), [(0.05, 0.0), (0.3, 0.03), (0.5, 0.2)])
def test_segments_stay_and_the_cloth_reaches_down_to_the_hem(length: float, flare: float) -> None:
    bare = build_body(Actor(height=1.6))
    dressed = build_body(Actor(height=1.6).in_skirt(Skirt(length=length, flare=flare)))
    np.testing.assert_array_equal(dressed.offsets_m[:-1], bare.offsets_m)
    np.testing.assert_allclose(dressed.offsets_m[-1], (0.0, 0.0, -1.6 * length))
    for one, other in zip(dressed.vertices_m, bare.vertices_m, strict=True):
        np.testing.assert_array_equal(one, other)
    assert [len(vertices_m) for vertices_m, _ in bare.surfaces[len(SEGMENT_NAMES) :]] == [0] * 5
    cloth = dressed.surfaces[len(SEGMENT_NAMES) :]
    assert [len(vertices_m) for vertices_m, _ in cloth[1:]] == [4] * 4
    for vertices_m, faces in cloth:
        assert is_closed(faces)
        assert volume_m3(vertices_m, faces) > 0
    cone_m = cloth[0][0]
    assert cone_m[:, 2].min() == pytest.approx(-1.6 * length)
    at_hips = np.abs(bare.vertices_m[PELVIS][:, 2]) < 0.02
    beyond_m = cone_m[:, 1].max() - bare.vertices_m[PELVIS][at_hips, 1].max()
    assert beyond_m == pytest.approx(1.6 * flare, abs=0.025)


def test_shape_and_bones_stretch_the_cone_with_the_pelvis() -> None:
    skirt = Skirt(length=0.3, flare=0.05)
    narrow, wide = (
        build_body(Actor(height=1.7, profiles={"pelvis": {"width": (w,)}}, skirt=skirt)) for w in (1.0, 1.2)
    )
    np.testing.assert_allclose(wide.cloth_m[0][:, 1], 1.2 * narrow.cloth_m[0][:, 1])
    np.testing.assert_array_equal(wide.offsets_m, narrow.offsets_m)


def test_where_nothing_else_moves_the_cone_is_shown_with_the_pelvis() -> None:
    body = build_body(Actor(skirt=Skirt(length=0.3, flare=0.05)))
    assert len(body.shown) == len(SEGMENT_NAMES)
    for s, (vertices_m, faces) in enumerate(body.shown):
        n_cone = len(body.cloth_m[0]) if s == PELVIS else 0
        assert len(vertices_m) == len(body.vertices_m[s]) + n_cone
        assert is_closed(faces)
