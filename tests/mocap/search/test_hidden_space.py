"""Where something may hide a limb is told by the cameras that show it, and only where some do not."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.skeleton import DOF_INDEX, SEGMENT_INDEX
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.picture import Region
from services.mocap.search.hidden_space import hidden_space
from services.mocap.search.model import Model
from services.mocap.types import Bytes, Floats, Mask

RIGHT_SHANK = (SEGMENT_INDEX["right_shank"],)
BEHIND = (0, 3)
"""Cameras from which furniture hides the shanks."""


@pytest.fixture(scope="module")
def standing_pose(standing: Callable[..., Floats]) -> Floats:
    return standing(shoulder_elevation=-60, hip_abduction=8)


@pytest.fixture(scope="module")
def bent_pose(standing_pose: Floats) -> Floats:
    """The same with a shank bent back, out of the way of what hides it."""
    bent = standing_pose.copy()
    bent[DOF_INDEX["right_knee_flexion"]] = np.radians(110)
    return bent


@pytest.fixture(scope="module")
def masks(standing_pose: Floats, silhouettes_of: Callable[[Floats], Bytes], model: Model) -> Mask:
    """(C, H, W) what all cameras would see."""
    return unpack(silhouettes_of(standing_pose), model.rig.n_cameras)


def _cut(masks: Mask) -> Mask:
    """The same masks with furniture before the shanks."""
    cut = masks.copy()
    for c in BEHIND:
        rows = np.flatnonzero(masks[c].any(axis=1))
        cut[c, rows[0] + round(0.75 * len(rows)) :] = False
    return cut


def _of(masks: Mask, model: Model, pose: Floats) -> Mask:
    return hidden_space(model, TriPlanes.sure(pack(masks)[None]), pose[None])


def test_where_others_show_a_leg_a_camera_may_be_hidden_from_it(
    model: Model, masks: Mask, standing_pose: Floats, bent_pose: Floats
) -> None:
    seen = _cut(masks)
    hidden = _of(seen, model, bent_pose)
    assert not (hidden & seen).any()
    covered = model.backend.coverage(standing_pose[None], RIGHT_SHANK, Region.whole(model.rig))[0]
    lost = unpack(covered, model.rig.n_cameras) & ~seen
    for c in BEHIND:
        assert lost[c].sum() > 50
        assert hidden[c][lost[c]].mean() > 0.9
    n_px = hidden.sum(axis=(1, 2))
    assert n_px[list(BEHIND)].sum() > 2 * np.delete(n_px, BEHIND).sum()


def test_nothing_may_be_hidden_where_the_body_explains_all_or_all_cameras_show_the_rest(
    model: Model, masks: Mask, standing_pose: Floats, bent_pose: Floats
) -> None:
    assert not _of(_cut(masks), model, standing_pose).any()
    assert not _of(masks, model, bent_pose).any()


def test_silhouettes_that_reach_the_edges_of_pictures_are_looked_at(model: Model, bent_pose: Floats) -> None:
    rig = model.rig
    whole = np.ones((rig.n_cameras, *rig.shape_px), bool)
    assert not _of(whole, model, bent_pose).any()
