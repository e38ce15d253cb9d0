"""What hides the actor from a camera is found, and nothing else is taken for it."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.model import Model
from services.mocap.search.occlusion import PosedFrame, find_occluded
from services.mocap.types import Bytes, Floats, Mask

TABLE = np.s_[150:190, 120:220]
"""In the first camera's picture."""


@pytest.fixture(scope="module")
def walk(standing: Callable[..., Floats]) -> Floats:
    """(24, D) somebody crosses the stage sideways with swinging arms."""
    poses = np.array([standing(shoulder_elevation=-70, hip_abduction=4 + k % 5) for k in range(24)])
    poses[:, 1] = np.linspace(-0.5, 0.5, len(poses))
    return poses


@pytest.fixture(scope="module")
def masks(walk: Floats, silhouettes_of: Callable[[Floats], Bytes], model: Model) -> Mask:
    """(24, C, H, W) what the cameras would see."""
    return np.array([unpack(silhouettes_of(pose), model.rig.n_cameras) for pose in walk])


def frames_of(masks: Mask, poses: Floats, *, is_lost: bool = False) -> list[PosedFrame]:
    return [PosedFrame(TriPlanes.sure(pack(m)), pose, is_lost) for m, pose in zip(masks, poses, strict=True)]


def test_furniture_is_found_where_the_actor_walks_behind_it(model: Model, walk: Floats, masks: Mask) -> None:
    behind = masks.copy()
    behind[:, 0][(slice(None), *TABLE)] = False
    hidden = find_occluded(model, frames_of(behind, walk))
    lost = masks[:, 0].sum(axis=0) - behind[:, 0].sum(axis=0)
    assert not hidden[1:].any()
    assert hidden[0][lost >= 5].mean() > 0.9
    grown = np.zeros(hidden[0].shape, bool)
    grown[TABLE[0].start - 2 : TABLE[0].stop + 2, TABLE[1].start - 2 : TABLE[1].stop + 2] = True
    assert not (hidden[0] & ~grown).any()


def test_nothing_is_found_on_an_empty_stage_or_for_a_body_that_is_too_wide(
    model: Model, walk: Floats, masks: Mask
) -> None:
    assert not find_occluded(model, frames_of(masks, walk)).any()
    stout = build_body(Actor(height=model.body.height_m * 1.03))
    backend = CpuBackend(stout, model.rig)
    still, pose = np.repeat(masks[:1], 24, axis=0), np.repeat(walk[:1], 24, axis=0)
    assert backend.coverage(pose[:1], ALL_SURFACES, Region.whole(model.rig)).any()
    assert not find_occluded(Model(stout, model.rig, backend), frames_of(still, pose)).any()
    backend.close()


def test_a_lost_body_tells_nothing(model: Model, walk: Floats, masks: Mask) -> None:
    """It would otherwise hide what it should be judged by."""
    seen, elsewhere = np.repeat(masks[:1], 24, axis=0), np.repeat(walk[-1:], 24, axis=0)
    assert find_occluded(model, frames_of(seen, elsewhere)).any()
    assert not find_occluded(model, frames_of(seen, elsewhere, is_lost=True)).any()


def test_all_of_the_furniture_is_hidden_where_the_empty_stage_shows_it(
    model: Model, walk: Floats, masks: Mask
) -> None:
    behind, stage = masks.copy(), np.full((*masks.shape[2:], 3), 180, np.uint8)
    behind[:, 0][(slice(None), *TABLE)] = False
    table = np.s_[TABLE[0].start : TABLE[0].stop, 60 : TABLE[1].stop]
    stage[table] = 40
    asked = list[int]()

    def stage_of(camera: int) -> Bytes:
        asked.append(camera)
        return stage

    hidden = find_occluded(model, frames_of(behind, walk), stage_of)
    assert hidden[0][table].all()
    assert asked == [0], "no other camera has anything hidden"
    assert not hidden[1:].any()
