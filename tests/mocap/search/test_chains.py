"""The table of chains covers the body once; windows follow their segments and stay in the pictures."""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.cloth_frames import WEBS
from services.mocap.body.kinematics import N_DOF, segment_transforms
from services.mocap.body.skeleton import DOF_NAMES, DOFS, LOWER, SEGMENT_NAMES, UPPER, bare
from services.mocap.camera.rig import Rig
from services.mocap.search.chains import (
    ALL_SURFACES,
    HEAD,
    LIMBS,
    TORSO,
    Limb,
    Stage,
    window_origins_px,
    window_size_px,
)
from services.mocap.search.model import Model
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Floats

BODY = build_body(Actor(height=1.75))
RIG = Rig.of(studio_cameras(5))
WINDOWED = [HEAD, *(stage for limb in LIMBS.values() for stage in (limb.main, limb.extremity))]


def test_every_parameter_is_found_by_exactly_one_chain() -> None:
    found = Counter(TORSO.dofs + HEAD.dofs + sum((limb.dofs for limb in LIMBS.values()), ()))
    assert found == Counter(range(N_DOF))


def test_stages_move_what_their_names_say() -> None:
    assert TORSO.surfaces == ALL_SURFACES
    assert [SEGMENT_NAMES[s] for s in HEAD.segments] == ["neck", "head"]
    for name, limb in LIMBS.items():
        side, kind = name.split("_")
        parts = ("upper_arm", "forearm", "hand") if kind == "arm" else ("thigh", "shank", "foot")
        assert [SEGMENT_NAMES[s] for s in limb.main.segments] == [f"{side}_{part}" for part in parts]
        assert [SEGMENT_NAMES[s] for s in limb.extremity.segments] == [f"{side}_{parts[2]}"]
        assert {DOF_NAMES[d].split("_")[0] for d in limb.dofs} == {side}


def test_segments_partition() -> None:
    trunk = {SEGMENT_NAMES.index("pelvis"), SEGMENT_NAMES.index("torso")}  # moved by nothing but the torso
    moved = Counter(HEAD.segments + sum((limb.main.segments for limb in LIMBS.values()), ()))
    assert set(moved.values()) == {1}
    assert set(moved) | trunk == set(range(len(SEGMENT_NAMES)))
    assert not set(moved) & trunk
    for stage in (TORSO, *WINDOWED):
        assert sorted(stage.surfaces + stage.others) == list(ALL_SURFACES)
        cloth = len(stage.surfaces) - len(stage.segments)
        moves = {bare(SEGMENT_NAMES[s]) for s in stage.segments}
        assert cloth == ("pelvis" in moves) + len(WEBS) * ("thigh" in moves)


@pytest.mark.parametrize("limb", LIMBS.values(), ids=LIMBS)
def test_a_limb_is_a_ball_and_a_hinge_with_limits(limb: Limb) -> None:
    assert [DOFS[d].role for d in limb.main.dofs] == ["swing", "swing", "twist", "swing"]
    assert set(limb.extremity.segments) < set(limb.main.segments)
    for stage in (limb.main, limb.extremity):
        assert np.isfinite([LOWER[list(stage.dofs)], UPPER[list(stage.dofs)]]).all()


@pytest.mark.parametrize(("width_px", "limb_px", "hand_px"), [(320, 128, 64), (640, 256, 128), (160, 64, 32)])
def test_window_sizes_scale_with_the_pictures_width(width_px: int, limb_px: int, hand_px: int) -> None:
    rig = Rig.of(studio_cameras(2, width_px, width_px * 3 // 4))
    for limb in LIMBS.values():
        assert window_size_px(limb.main, rig) == limb_px
        assert window_size_px(limb.extremity, rig) == hand_px
    assert window_size_px(HEAD, rig) == hand_px
    assert window_size_px(TORSO, rig) == 0


@given(st.integers(0, 2**32 - 1), st.sampled_from(WINDOWED), st.floats(0.0, 8.0))
@settings(max_examples=60, deadline=None)
def test_windows_stay_inside_the_pictures(seed: int, stage: Stage, reach_m: float) -> None:
    """Wherever the body stands, behind a camera too."""
    rng = np.random.default_rng(seed)
    pose = rng.uniform(np.maximum(LOWER, -3.0), np.minimum(UPPER, 3.0))
    pose[:3] = rng.uniform(-reach_m, reach_m, 3)
    origins_px = window_origins_px((stage,), pose, BODY, RIG)[0]
    assert origins_px.dtype == np.int32
    assert np.all(origins_px >= 0)
    assert np.all(origins_px + window_size_px(stage, RIG) <= RIG.sizes_px)


def test_windows_larger_than_a_picture_begin_at_its_corner() -> None:
    small = Rig(RIG.P_px_world, np.tile(np.array([[320, 60]], np.int32), (RIG.n_cameras, 1)))
    origins_px = window_origins_px((LIMBS["left_leg"].main,), np.zeros(N_DOF), BODY, small)[0]
    assert np.all(origins_px[:, 1] == 0)


@pytest.mark.parametrize("stage", WINDOWED, ids=[SEGMENT_NAMES[stage.segments[0]] for stage in WINDOWED])
def test_windows_are_centred_on_their_segments(
    stage: Stage, model: Model, standing: Callable[..., Floats]
) -> None:
    pose = standing(shoulder_elevation=-60, root_heading=30)
    T_world_segment = segment_transforms(pose[None], model.body.offsets_m)[0]
    centres_world_m = [T_world_segment[s] @ np.append(model.body.centres_m[s], 1.0) for s in stage.segments]
    middle_px = model.rig.P_px_world @ np.mean(centres_world_m, axis=0)
    middle_px = middle_px[:, :2] / middle_px[:, 2:]
    size_px = window_size_px(stage, model.rig)
    origins_px = window_origins_px((stage,), pose, model.body, model.rig)[0]
    free = (origins_px > 0) & (origins_px < model.rig.sizes_px - size_px)
    assert free.mean() > 0.5
    off_px = origins_px + size_px / 2 - middle_px
    assert np.abs(off_px[free]).max() <= 0.5
