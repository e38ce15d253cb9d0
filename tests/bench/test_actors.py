"""Random people of the bench: what they are, and that a fit finds two of them."""

from dataclasses import replace

import numpy as np
import pytest

from bench.actor_tables import as_tables
from bench.actors import BONES, Found, Row, Trial, measure
from bench.later_motion import MOTIONS, going_on
from bench.random_bodies import Stance, Variety, somebody
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.synth.studio import studio_cameras


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.of(studio_cameras(8))


@pytest.mark.parametrize("variety", Variety)
@pytest.mark.parametrize("stance", Stance)
def test_people_stand_on_the_floor_in_all_pictures(rig: Rig, variety: Variety, stance: Stance) -> None:
    for seed in range(2):
        person = somebody(rig, variety, stance, 2, seed)
        assert 1.49 < person.body.standing_height_m < 2.01
        for pose in person.poses:
            assert person.body.lowest_point_m(pose) == pytest.approx(0.0, abs=1e-9)
        exact = unpack(
            CpuBackend(person.body, rig).coverage(person.poses, ALL_SURFACES, Region.whole(rig))[0],
            rig.n_cameras,
        )
        seen = unpack(person.seen.silhouettes[0], rig.n_cameras)
        assert not exact[:, [0, -1]].any()
        assert not exact[:, :, [0, -1]].any()
        both, either = (exact & seen).sum(axis=(1, 2)), (exact | seen).sum(axis=(1, 2))
        assert np.all(both > 0.9 * either)  # they are noisy, and still silhouettes of that person
        assert np.all(both < either)


def test_a_seed_makes_the_same_person_and_another_one_does_not(rig: Rig) -> None:
    one, again, other = (somebody(rig, Variety.POPULATION, Stance.RELAXED, 1, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.seen.silhouettes, again.seen.silhouettes)
    assert np.array_equal(one.x, again.x)
    assert not np.array_equal(one.x, other.x)


def test_people_go_on_from_where_they_stood(rig: Rig) -> None:
    for motion in MOTIONS:
        person = somebody(rig, Variety.POPULATION, Stance.T_POSE, 2, 3)
        later = going_on(person, rig, motion, 60, 3)
        assert later.poses.shape == (60, N_DOF)
        assert len(later.seen) == 60
        for pose in later.poses:
            assert person.body.lowest_point_m(pose) == pytest.approx(0.0, abs=1e-9)
        poses = np.vstack([person.poses[-1:], later.poses])
        assert np.abs(np.diff(poses, axis=0)).max() < 0.8  # nobody jumps
        assert np.ptp(poses[:, 6:], axis=0).max() > np.radians(40)


def test_a_fit_finds_people() -> None:
    (row,) = measure(Trial(Variety.POPULATION, 2, 8, seed=0), (2,))
    assert row.stance is Stance.RELAXED
    assert abs(row.heading_deg) < 10.0
    assert row.motion == "walk"
    assert row.refined is not None
    for found in (row.first, row.refined):
        assert abs(found.height_cm) < 1.0
        assert np.median([abs(found.bones_percent[bone]) for bone in BONES]) < 3.0
        assert abs(found.bones_percent[found.worst_bone]) < 10.0
        assert found.iou > 0.9


def test_what_was_asked_for_is_counted() -> None:
    bones = dict.fromkeys([*BONES, "pelvis", "torso"], 1.0)
    right = Found(0.4, bones | {"pelvis": 9.0}, 5.0, 0.95, 9.0)
    short_hand = replace(right, bones_percent=bones | {"hand": -5.1})
    assert right.is_right
    assert not replace(right, height_cm=-1.1).is_right
    assert not short_hand.is_right
    assert short_hand.worst_bone == "hand"
    good = Row(Variety.POPULATION, 0, "male", Stance.A_POSE, 1.8, 2.0, right, "walk", right)
    assert good.faces_right
    assert not replace(good, heading_deg=-178.0).faces_right
    table = as_tables([good, replace(good, number=1, heading_deg=170.0, first=short_hand)])[-1]
    assert list(table.columns[1].cells) == ["2 of 2", "1 of 2", "1 of 2"]
    assert list(table.columns[2].cells) == ["2 of 2", "2 of 2", ""]
    alone = as_tables([replace(good, motion=None, refined=None)])[-1]
    assert [list(column.cells) for column in alone.columns[1:]] == [["1 of 1", "1 of 1", "1 of 1"]]
