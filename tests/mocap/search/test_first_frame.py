"""The first frame: what is known of actor and pose is used, what is not is found."""

import logging

import numpy as np
import pytest

from services.mocap.body.actor import DEFAULT_HEIGHT_M, Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import DOF_INDEX, SIDES
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.engine import open_engine
from services.mocap.energy.picture import Picture, Region
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import CertainError, TakeError
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.first_frame import FirstFrameSearch
from services.mocap.search.hull import Hull, carve
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.synth.studio import studio_cameras
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Bytes, Floats

RIG = Rig.of(studio_cameras(5))
HEIGHT_M = 1.80
CPU = open_engine(EngineSettings(backend="cpu"))


def _hints(**fields: object) -> TakeSettings:
    return TakeSettings.model_validate(
        {"name": "t", "fps": 15.0, "units": "m", "up": "z", "frames": 1, **fields}
    )


def _pool(model: Model, actor: Actor) -> LocalLimbs:
    assert model.body.height_m == actor.height
    return LocalLimbs(model)


def _search(hints: TakeSettings, settings: SearchSettings | None = None) -> FirstFrameSearch:
    return FirstFrameSearch(RIG, hints, _pool, CPU, settings or SearchSettings())


def _pose() -> Floats:
    pose = np.zeros(N_DOF)
    pose[:3] = 0.2, 0.1, build_body(Actor(height=HEIGHT_M)).pelvis_height_m
    pose[DOF_INDEX["root_heading"]] = 2.0
    for side in SIDES:
        pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = -1.1
        pose[DOF_INDEX[f"{side}_hip_abduction"]] = 0.1
    return pose


def _silhouettes(pose: Floats) -> Bytes:
    body = build_body(Actor(height=HEIGHT_M))
    return CpuBackend(body, RIG).coverage(pose[None], ALL_SURFACES, Region.whole(RIG))[0]


def _seen() -> TriPlanes:
    return TriPlanes.sure(_silhouettes(_pose()))


def _mean_error_mm(found: Floats, actor: Actor) -> float:
    ours = joint_positions(found[None], build_body(actor).offsets_m)
    truth = joint_positions(_pose()[None], build_body(Actor(height=HEIGHT_M)).offsets_m)
    return float(1000 * np.linalg.norm(ours - truth, axis=-1).mean())


def test_height_and_pose_are_found_when_nothing_is_said(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        found = _search(_hints()).solve(_seen(), None)
    assert abs(found.actor.height - HEIGHT_M) < 0.02
    assert _mean_error_mm(found.solution.pose, found.actor) < 25
    assert "take.toml has no actor_height" in caplog.text


def test_the_height_of_take_toml_is_kept() -> None:
    hints = _hints(actor_height=1.78, initial_pose={"root_heading_rad": 2.0})
    found = _search(hints).solve(_seen(), None)
    assert found.actor == Actor(height=1.78)


def test_an_actor_outweighs_the_height_of_take_toml() -> None:
    actor = Actor(height=HEIGHT_M, bone_lengths={"hand": 0.2})
    hints = _hints(actor_height=1.6, initial_pose={"root_heading_rad": 2.0})
    assert _search(hints).solve(_seen(), actor).actor == actor


def test_a_pose_that_was_fitted_is_not_searched_far_and_wide() -> None:
    actor, near = Actor(height=HEIGHT_M), _pose()
    near[0] += 0.01
    near[DOF_INDEX["root_heading"]] += 0.02
    hints, once = (
        _hints(facing=300.0),
        SearchSettings(max_passes=1),
    )  # what it says has had its say in the fit
    found = _search(hints, once).solve(_seen(), actor, near)
    assert found.actor == actor
    assert found.solution.passes == 0
    assert _mean_error_mm(found.solution.pose, actor) < 10


@pytest.mark.parametrize("turned_deg", [0, 180])
def test_facing_decides(turned_deg: float) -> None:
    hints = _hints(actor_height=HEIGHT_M, facing=np.degrees(2.0) + turned_deg)
    found = _search(hints).solve(_seen(), None).solution
    turned = np.radians(turned_deg)
    assert np.cos(found.pose[DOF_INDEX["root_heading"]] - 2.0 - turned) > np.cos(0.6)


@pytest.mark.usefixtures("quick_first_pose")
def test_two_people_who_stand_close_are_refused_unless_the_body_is_known(
    caplog: pytest.LogCaptureFixture,
) -> None:
    pose, other = _pose(), _pose()
    other[:3] += 0.5 * np.cos(3.57), 0.5 * np.sin(3.57), 0.0  # beside each other
    both, hints = TriPlanes.sure(_silhouettes(pose) | _silhouettes(other)), _hints(facing=np.degrees(2.0))
    with pytest.raises(TakeError, match=r"^silhouettes: one body covers only \d\d% .* two people close"):
        _search(hints).solve(both, None)
    actor = Actor(height=HEIGHT_M)
    with caplog.at_level(logging.WARNING):
        assert _search(hints).solve(both, actor).actor == actor
    assert "two people close together" in caplog.text


@pytest.mark.usefixtures("quick_first_pose")
def test_much_that_is_unsure_is_blamed_before_a_second_person() -> None:
    pose, other = _pose(), _pose()
    other[:3] += 0.5 * np.cos(3.57), 0.5 * np.sin(3.57), 0.0
    possible = unpack(_silhouettes(pose) | _silhouettes(other), RIG.n_cameras)
    unsure = np.zeros_like(possible)
    rows = np.flatnonzero(possible[3].any(axis=1))
    unsure[3, rows[0] + round(0.7 * len(rows)) :] = True
    unsure &= possible
    seen = TriPlanes(pack(possible & ~unsure), pack(unsure))
    said = r"^silhouettes: \d\d% of the possible actor in camera 4 of 5 cannot be told .* two people close"
    with pytest.raises(TakeError, match=said):
        _search(_hints(facing=np.degrees(2.0))).solve(seen, None)


def test_somebody_who_lies_is_no_dwarf(caplog: pytest.LogCaptureFixture) -> None:
    lying = _pose()
    lying[2], lying[DOF_INDEX["root_pitch"]] = 0.15, -np.pi / 2
    seen, usual = _silhouettes(lying), SearchSettings(search_limbs="never", max_passes=1)
    hull, picture = carve(RIG, unpack(seen, RIG.n_cameras)), Picture.of_frame(RIG, TriPlanes.sure(seen))
    assert hull.lies(HEIGHT_M)
    assert not hull.lies(0.7 * HEIGHT_M / 2)
    assert not carve(RIG, unpack(_silhouettes(_pose()), RIG.n_cameras)).lies(HEIGHT_M)
    guess = _search(_hints(), usual).guess(hull, picture, None, is_fitted_next=True)
    assert guess.actor.height == DEFAULT_HEIGHT_M
    assert "seems to lie or crawl: a height of 1.72 m is assumed" in caplog.text
    assert "check the scale" not in caplog.text


def test_a_small_world_is_refused() -> None:
    """Somebody who stands and is half a metre high."""
    hull = carve(RIG, unpack(_silhouettes(_pose()), RIG.n_cameras))
    shrunk = Hull(0.3 * hull.points_world_m, hull.firm)
    picture = Picture.of_frame(RIG, _seen())
    with pytest.raises(TakeError, match=r"is 0\.5\d m high: check that translations are in metres"):
        _search(_hints()).guess(shrunk, picture, None)


def test_a_world_in_feet_is_refused_for_certain() -> None:
    hull = carve(RIG, unpack(_silhouettes(_pose()), RIG.n_cameras))
    grown = Hull(3.28 * hull.points_world_m, hull.firm)
    with pytest.raises(CertainError, match=r"is 5\.\d\d m high: check that translations are in metres"):
        _search(_hints()).guess(grown, Picture.of_frame(RIG, _seen()), None)


def test_an_empty_stage_is_said() -> None:
    nobody = TriPlanes.sure(np.zeros((1, *RIG.shape_px), np.uint8))
    with pytest.raises(TakeError, match="choose a first frame"):
        _search(_hints()).solve(nobody, None)
