"""Errors by part add up to the energy and lie where they should, and overlaps are what they are."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.picture import Picture
from services.mocap.search.error_by_part import error_by_part
from services.mocap.search.model import Model
from services.mocap.take.marks import PARTS
from services.mocap.types import Bytes, Floats


@pytest.fixture
def wrong(standing: Callable[..., Floats]) -> Floats:
    """A left arm half a right angle off."""
    pose = standing()
    pose[DOF_INDEX["left_shoulder_elevation"]] += 0.8
    return pose


def test_the_right_pose_leaves_nothing(
    model: Model, standing: Callable[..., Floats], picture_of: Callable[[Floats], Picture]
) -> None:
    found = error_by_part(model, picture_of(standing()), standing())
    assert found.energy_px == 0
    assert found.part_px == dict.fromkeys(PARTS, 0)
    assert found.iou == [1.0] * 8


def test_an_arm_that_is_elsewhere_is_the_arms_energy(
    model: Model, standing: Callable[..., Floats], silhouettes_of: Callable[[Floats], Bytes], wrong: Floats
) -> None:
    truth, drawn = silhouettes_of(standing()), silhouettes_of(wrong)
    found = error_by_part(model, Picture.whole(model.rig, truth), wrong)
    masks, model_masks = unpack(truth, 8), unpack(drawn, 8)
    assert found.energy_px == (masks ^ model_masks).sum() == sum(found.part_px.values())
    assert found.part_px["left_arm"] > 0.6 * found.energy_px
    assert found.part_px["right_arm"] + found.part_px["right_leg"] < 0.02 * found.energy_px
    common, either = (masks & model_masks).sum(axis=(1, 2)), (masks | model_masks).sum(axis=(1, 2))
    assert found.iou == pytest.approx(common / either)


def test_a_camera_that_shows_nothing_of_both_agrees(
    model: Model, standing: Callable[..., Floats], silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    pose = standing()
    masks = unpack(silhouettes_of(pose), 8)
    masks[3] = False
    hidden = np.zeros_like(masks)
    hidden[5] = True
    picture = Picture.whole(model.rig, pack(masks)).ignoring(pack(hidden))
    found = error_by_part(model, picture, pose)
    assert found.iou == [1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    assert found.energy_px == unpack(silhouettes_of(pose), 8)[3].sum()

    # Tracking doubts a camera that shows nobody while others do: it disagrees, but costs nothing.
    doubted = error_by_part(model, model.picture_of(TriPlanes.sure(pack(masks))), pose)
    assert doubted.iou == found.iou
    assert doubted.energy_px == 0

    # A body behind something that is unsure does not disagree.
    behind = TriPlanes(pack(np.zeros_like(masks)), silhouettes_of(pose))
    assert error_by_part(model, model.picture_of(behind), pose).iou == [1.0] * 8
