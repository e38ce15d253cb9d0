"""Pictures show all of the model, a skirt too, each part by its side."""

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.garments import Skirt
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.export.model_painter import ModelPainter
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.synth.studio import studio_cameras
from services.mocap.take.marks import PARTS


@pytest.mark.parametrize("skirt", [None, Skirt(length=0.3, flare=0.05)])
def test_everything_that_is_drawn_has_a_side(skirt: Skirt | None) -> None:
    body, rig = build_body(Actor(skirt=skirt)), Rig.of(studio_cameras(3))
    pose = np.zeros(N_DOF)
    pose[2], pose[DOF_INDEX["left_hip_flexion"]] = body.pelvis_height_m, 0.8
    masks = np.array(ModelPainter(body, rig).segment_masks(pose))
    covered = CpuBackend(body, rig).coverage(pose[None], ALL_SURFACES, Region.whole(rig))[0]
    np.testing.assert_array_equal(masks > 0, unpack(covered, rig.n_cameras))
    assert set(np.unique(masks)) == {0, 1, 2, 3}


def test_doubtful_parts_are_covered_and_all_of_a_doubtful_body_with_its_skirt() -> None:
    body, rig = build_body(Actor(skirt=Skirt(length=0.3, flare=0.05))), Rig.of(studio_cameras(3))
    pose = np.zeros(N_DOF)
    pose[2] = body.pelvis_height_m
    painter = ModelPainter(body, rig)
    masks = painter.segment_masks(pose)
    assert painter.doubtful(pose, np.zeros(6, bool)) is None
    arm, whole = (painter.doubtful(pose, np.array(PARTS) == part) for part in ("left_arm", "torso"))
    assert arm is not None and whole is not None
    for mask, of_arm, of_body in zip(masks, arm, whole, strict=True):
        np.testing.assert_array_equal(of_body, mask > 0)
        assert 0.02 < (of_arm & (mask == 2)).sum() / (mask > 0).sum() < 0.2
    np.testing.assert_array_equal(np.array(arm), painter.covered(pose, (4, 5, 6)))
