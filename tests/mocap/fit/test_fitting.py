"""Fitting shapes and poses to silhouettes of people whose shape and poses are known."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.shape_space import DEVIATIONS, INDEX, actor_of, body_of, vector_of, without_shoes
from services.mocap.body.skeleton import dofs_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.fit.contours import contours_of
from services.mocap.fit.fitting import Fit, fit_actor
from services.mocap.fit.least_squares import Fitting
from services.mocap.fit.normal_equations import ALL_DOFS, FitStage, State
from services.mocap.fit.priors import Prior
from services.mocap.fit.quality import FitQuality, quality_of
from services.mocap.search.chains import ALL_SURFACES

_GENERIC = Actor()


def _errors_mm(fit: Fit, person: Any) -> tuple[float, float]:
    """How far off the height is, and the mean joint."""
    body = build_body(fit.actor)
    found, true = (
        joint_positions(poses, b.offsets_m) for poses, b in ((fit.poses, body), (person.poses, person.body))
    )
    off_m = abs(body.standing_height_m - person.body.standing_height_m)
    return 1000.0 * off_m, 1000.0 * float(np.linalg.norm(found - true, axis=2).mean())


def test_a_person_of_unknown_shape_is_found(rig: Rig, a_person: Callable[..., Any]) -> None:
    person, shares = a_person(0, 2), list[float]()
    fit = fit_actor(rig, person.seen, _GENERIC, person.guess, shares.append)
    height_mm, joints_mm = _errors_mm(fit, person)
    assert height_mm < 10
    assert joints_mm < 15
    assert fit.after.iou.mean() > 0.96
    barefoot = body_of(without_shoes(vector_of(fit.actor)))
    assert fit.actor.height == pytest.approx(barefoot.standing_height_m, abs=0.003)
    assert abs(vector_of(fit.actor)[INDEX["shank"]] - person.x[INDEX["shank"]]) < 0.08
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < 0.1
    assert shares[-1] == 1.0


def test_a_told_height_is_kept_and_shoes_and_a_hat_are_none_of_it(
    rig: Rig, a_person: Callable[..., Any]
) -> None:
    person = a_person(1, 1)
    x = person.x.copy()
    x[INDEX["head"]] += 0.15
    x[INDEX["foot_depth"]] += 0.3
    body, true = body_of(x), actor_of(person.x)
    seen = TriPlanes.sure(CpuBackend(body, rig).coverage(person.poses, ALL_SURFACES, Region.whole(rig)))
    told = fit_actor(rig, seen, _GENERIC, person.guess, height_m=true.height)
    assert told.actor.height == pytest.approx(true.height, rel=0.01)
    assert build_body(told.actor).standing_height_m > true.height + 0.02


def test_a_body_of_another_form_is_drawn_towards_people(rig: Rig, a_person: Callable[..., Any]) -> None:
    """A coat to the knees: nobody's bones are what would fill it best."""
    person = a_person(1, 1)
    masks = unpack(person.seen.silhouettes[0], rig.n_cameras)
    coat = np.zeros_like(masks)
    for c, mask in enumerate(masks):
        rows = np.flatnonzero(mask.any(axis=1))
        top, bottom = (int(rows[0] + share * len(rows)) for share in (0.2, 0.7))
        coat[c] = mask
        coat[c, top:bottom] = ndimage.binary_dilation(mask, iterations=4)[top:bottom]
    fit = fit_actor(rig, TriPlanes.sure(pack(coat)[None]), _GENERIC, person.guess)
    bones = [INDEX[bone] for bone in ("upper_arm", "forearm", "thigh", "shank")]
    assert np.all(np.abs(vector_of(fit.actor)[bones]) < 2.5 * DEVIATIONS[bones])


def test_a_waist_that_bends_is_found_and_the_published_body_never_bent(
    rig: Rig, a_person: Callable[..., Any]
) -> None:
    person, waist = a_person(1, 1), list(dofs_of("waist"))
    bowed = person.poses.copy()
    bowed[:, waist] = np.radians([25.0, 8.0, 12.0])
    seen = TriPlanes.sure(CpuBackend(person.body, rig).coverage(bowed, ALL_SURFACES, Region.whole(rig)))
    guess = person.guess.copy()
    guess[waist] = np.radians([15.0, 0.0, 0.0])
    found, rigid = fit_actor(rig, seen, _GENERIC, guess), fit_actor(rig, seen, _GENERIC, guess, body="paper")
    np.testing.assert_allclose(found.poses[0, waist], bowed[0, waist], atol=np.radians(6))
    np.testing.assert_array_equal(rigid.poses[0, waist], 0.0)
    assert rigid.after.energy_px.sum() < rigid.before.energy_px.sum()
    assert found.after.energy_px.sum() < 0.7 * rigid.after.energy_px.sum()


def test_one_camera_with_the_wrong_picture_does_no_harm(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(2, 1)
    masks = np.array([unpack(planes, rig.n_cameras) for planes in person.seen.silhouettes])
    masks[:, 3] = np.roll(masks[:, 3], (12, 25), axis=(1, 2))
    seen = TriPlanes.sure(np.array([pack(frame) for frame in masks]))
    height_mm, joints_mm = _errors_mm(fit_actor(rig, seen, _GENERIC, person.guess), person)
    assert height_mm < 15
    assert joints_mm < 25


def test_empty_and_cut_off_cameras_count_for_what_they_show(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(4, 1)
    masks = np.array([unpack(planes, rig.n_cameras) for planes in person.seen.silhouettes])
    masks[:, 0] = False
    sizes_px = rig.sizes_px.copy()
    sizes_px[1, 1] = np.nonzero(masks[0, 1].any(axis=1))[0].max() - 30  # its picture ends at the shins
    masks[:, 1, sizes_px[1, 1] :] = False
    seen = TriPlanes.sure(np.array([pack(frame) for frame in masks]))
    fit = fit_actor(replace(rig, sizes_px=sizes_px), seen, _GENERIC, person.guess)
    height_mm, joints_mm = _errors_mm(fit, person)
    assert height_mm < 15
    assert joints_mm < 20


def test_a_perfect_start_stays(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(3, 1)
    truth = actor_of(person.x)
    fit = fit_actor(rig, person.seen, truth, person.poses)
    assert fit.before.energy_px.sum() == 0
    assert fit.after.energy_px.sum() == 0
    assert fit.actor == truth
    assert np.array_equal(fit.poses, person.poses)


@pytest.mark.parametrize(("times_as_much", "is_dropped"), [(1.04, False), (1.06, True)])
def test_a_result_with_clearly_more_energy_than_the_start_is_dropped(
    rig: Rig,
    a_person: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
    times_as_much: float,
    is_dropped: bool,
) -> None:
    person, looks = a_person(3, 1), list[FitQuality]()

    def as_if(*asked: Any) -> FitQuality:
        looks.append(quality_of(*asked))
        return replace(looks[0], energy_px=looks[0].energy_px * (times_as_much if looks[1:] else 1.0))

    monkeypatch.setattr("services.mocap.fit.fitting.quality_of", as_if)
    fit = fit_actor(rig, person.seen, _GENERIC, person.guess)
    assert (fit.actor == _GENERIC) == is_dropped


def test_poses_for_other_frames_are_refused(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(5, 1)
    with pytest.raises(ValueError, match=rf"poses: expected \(1, {N_DOF}\) or one pose, got \(2, {N_DOF}\)"):
        fit_actor(rig, person.seen, _GENERIC, np.tile(person.guess, (2, 1)))


def test_quality_counts_pixels(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(6, 1)
    exact = quality_of(person.body, person.poses, rig, person.seen)
    assert np.all(exact.iou == 1.0)
    masks = unpack(person.seen.silhouettes[0], rig.n_cameras)
    half = masks.copy()
    y, x = np.nonzero(masks[2])
    half[2, y[::2], x[::2]] = False
    found = quality_of(person.body, person.poses, rig, TriPlanes.sure(pack(half)[None]))
    assert found.energy_px[0] == len(y[::2])
    assert found.iou[0, 2] == pytest.approx(1.0 - len(y[::2]) / len(y))
    assert np.all(np.delete(found.iou[0], 2) == 1.0)


def test_no_pose_is_better_for_being_outside_of_the_pictures(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(2, 1)
    stage = FitStage((), ALL_DOFS, cap_px=15.0, steps=1)
    fitting = Fitting(rig, contours_of(rig, person.seen, 250), Prior(person.poses))
    away = person.poses.copy()
    away[:, 2] += 50.0  # over all pictures
    near, far = (fitting.cost(State(person.x, poses), stage) for poses in (person.poses, away))
    assert far > 3 * near
