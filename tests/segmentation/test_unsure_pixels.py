"""What is unsure about a silhouette: gaps in the actor sooner than the space about it."""

import numpy as np
import pytest

from services.mocap.types import Bytes, Mask
from services.segmentation.unsure import unsure_pixels

SHAPE_PX = (240, 320)
"""Of the picture; a gap is at most 13 pixels wide."""
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
    actor: Bytes, stage_evidence: float, actor_evidence: float, prior: float, *, are_cameras_few: bool = True
) -> Mask:
    own = np.where(actor > 0, actor_evidence, stage_evidence).astype(np.float32)
    priors = np.full(SHAPE_PX, prior, np.float32)
    return unsure_pixels(actor, own, priors, SHAPE_PX, are_cameras_few=are_cameras_few)


@pytest.mark.parametrize(
    ("evidence", "in_gap", "beside"),
    [(-0.5, True, True), (-1.3, True, False), (-2.0, False, False)],
)
def test_before_few_cameras_a_patch_like_the_wall_is_unsure_within_a_gap_only(
    actor: Bytes, evidence: float, in_gap: bool, beside: bool
) -> None:
    of_few, of_many = (
        unsure(actor, evidence, 3.0, SEEN_BY_OTHERS, are_cameras_few=few) for few in (True, False)
    )
    assert (of_few[GAP] == in_gap).all()
    assert (of_few[BESIDE] == beside).all()
    assert (of_many[BESIDE] == in_gap).all()
    assert not (of_few | of_many)[actor > 0].any()


def test_what_no_other_camera_sees_is_background(actor: Bytes) -> None:
    assert not unsure(actor, -1.0, 3.0, NOT_SEEN).any()


def test_what_was_kept_against_all_evidence_is_unsure(actor: Bytes) -> None:
    found = unsure(actor, -3.0, -0.7, NOT_SEEN)
    assert found[TRUNK].all()
    assert not unsure(actor, -3.0, -0.7, SEEN_BY_OTHERS)[TRUNK].any()
