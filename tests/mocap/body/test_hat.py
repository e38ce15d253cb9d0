"""A hat is part of the head's surface, and changes nothing else."""

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.garments import Hat, Skirt
from services.mocap.body.shape_space import actor_of, vector_of, with_true_height
from services.mocap.body.skeleton import SEGMENT_INDEX, SEGMENT_NAMES
from services.mocap.body.surface import is_closed, volume_m3

HEAD = SEGMENT_INDEX["head"]
HAT = Hat(brim=1.75, peak=1.75, rim=0.03, crown=0.02)


@pytest.mark.parametrize(
    "hat",
    [
        HAT,
        Hat(brim=1.0, peak=1.0, rim=0.0, crown=0.0),
        Hat(brim=3.0, peak=3.0, rim=0.08, crown=0.15),
        Hat(brim=1.1, peak=1.7, rim=0.03, crown=0.01),
    ],
)
def test_a_brim_and_a_crown_are_added_to_the_head(hat: Hat) -> None:
    bare, dressed = build_body(Actor(height=1.6)), build_body(Actor(height=1.6).in_hat(hat))
    np.testing.assert_array_equal(dressed.offsets_m, bare.offsets_m)
    for name, one, other in zip(SEGMENT_NAMES, dressed.vertices_m, bare.vertices_m, strict=True):
        np.testing.assert_array_equal(one[: len(other)], other)
        assert len(one) == len(other) or name == "head"
    added_m = dressed.vertices_m[HEAD][len(bare.vertices_m[HEAD]) :]
    assert is_closed(dressed.faces[HEAD])
    assert volume_m3(dressed.vertices_m[HEAD], dressed.faces[HEAD]) > volume_m3(*bare.surfaces[HEAD])
    head_m = bare.vertices_m[HEAD]
    assert added_m[:, 2].max() == pytest.approx(head_m[:, 2].max() + 1.6 * hat.crown, abs=1e-3)
    assert added_m[:, 2].min() == pytest.approx(1.6 * hat.rim, abs=1e-3)
    behind, ahead = max(hat.brim, 1.1), max(hat.peak, 1.1)
    assert np.ptp(added_m[:, 0]) == pytest.approx(1.6 * 0.057 * (behind + ahead), rel=0.06)
    assert added_m[:, 0].max() == pytest.approx(1.6 * (0.0005 + 0.057 * ahead), rel=0.06)
    assert np.ptp(added_m[:, 1]) == pytest.approx(1.6 * 0.0876 * max(hat.brim, 1.1), rel=0.03)


def test_it_goes_with_a_skirt_and_is_taken_off_to_measure() -> None:
    dressed = Actor(height=1.6).in_skirt(Skirt(length=0.3, flare=0.05)).in_hat(HAT)
    assert dressed.bare == Actor(height=1.6)
    assert len(build_body(dressed).cloth_m[0]) > 0
    assert len(build_body(dressed).vertices_m[HEAD]) > len(build_body(dressed.bare).vertices_m[HEAD])


def test_the_height_is_that_without_it() -> None:
    x = vector_of(Actor(height=1.7))
    np.testing.assert_array_equal(with_true_height(x, Actor().in_hat(HAT)), with_true_height(x))
    assert actor_of(x, Actor().in_hat(HAT)).hat == HAT
