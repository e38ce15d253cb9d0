"""What is unsure about a silhouette: gaps in the actor sooner than the space about it."""

import numpy as np
import pytest

from services.mocap.types import Bytes, Mask
from services.segmentation.unsure import unsure_pixels

SHAPE_PX = (240, 320)
"""Of the picture; a gap is at most 12 pixels wide."""
ARM, TRUNK = np.s_[60:160, 100:112], np.s_[60:160, 122:160]
GAP, BESIDE = np.s_[70:150, 115:119], np.s_[70:150, 40:90]
SEEN_BY_OTHERS, NOT_SEEN = 1.0, -1.5


@pytest.fixture(scope="module")
def actor() -> Bytes:
    """An arm beside a trunk, ten pixels apart."""
    actor: Bytes = np.zeros(SHAPE_PX, np.uint8)
    actor[ARM] = actor[TRUNK] = 1
    return actor


def unsure(
    actor: Bytes, stage_evidence: float, actor_evidence: float, prior: float, *, has_few_cameras: bool = True
) -> Mask:
    own = np.where(actor > 0, actor_evidence, stage_evidence).astype(np.float32)
    priors = np.full(SHAPE_PX, prior, np.float32)
    return unsure_pixels(actor, own, priors, SHAPE_PX, has_few_cameras=has_few_cameras)


@pytest.mark.parametrize(
    ("evidence", "in_gap", "beside"),
    [(-0.5, True, True), (-1.3, True, False), (-2.0, False, False)],
)
def test_with_few_cameras_a_patch_like_the_wall_is_unsure_in_a_gap_only(
    actor: Bytes, evidence: float, in_gap: bool, beside: bool
) -> None:
    found = unsure(actor, evidence, 3.0, SEEN_BY_OTHERS)
    assert (found[GAP] == in_gap).all()
    assert (found[BESIDE] == beside).all()
    assert not found[actor > 0].any()


@pytest.mark.parametrize(("evidence", "is_unsure"), [(-1.3, True), (-2.0, False)])
def test_with_many_cameras_gaps_make_no_difference(actor: Bytes, evidence: float, is_unsure: bool) -> None:
    found = unsure(actor, evidence, 3.0, SEEN_BY_OTHERS, has_few_cameras=False)
    assert (found[GAP] == is_unsure).all()
    assert (found[BESIDE] == is_unsure).all()


def test_the_edge_of_a_part_closes_no_gap(actor: Bytes) -> None:
    """A picture is segmented in a part that ends soon beside the actor."""
    large: Bytes = np.kron(actor, np.ones((4, 4), np.uint8))
    part = np.s_[200:680, 380:670]
    own, prior = np.full(large.shape, -1.3, np.float32), np.full(large.shape, 1.0, np.float32)
    whole = unsure_pixels(large, own, prior, large.shape, has_few_cameras=True)
    alone = unsure_pixels(large[part], own[part], prior[part], large.shape, has_few_cameras=True)
    inner = np.s_[2:-2, 2:-2]  # means reach over the edge
    np.testing.assert_array_equal(alone[inner], whole[part][inner])


def test_what_no_other_camera_sees_is_background(actor: Bytes) -> None:
    assert not unsure(actor, -1.0, 3.0, NOT_SEEN).any()


def test_what_was_kept_against_all_evidence_is_unsure(actor: Bytes) -> None:
    found = unsure(actor, -3.0, -0.7, NOT_SEEN)
    assert found[TRUNK].all()
    assert not unsure(actor, -3.0, -0.7, SEEN_BY_OTHERS)[TRUNK].any()
