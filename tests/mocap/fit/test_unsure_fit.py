"""A fit leaves alone what unsure pixels hide: feet that nobody is sure of shorten no leg."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import JOINT_INDEX, SEGMENT_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.fit.contours import Contour, contours_of
from services.mocap.fit.fitting import fit_actor
from services.mocap.fit.quality import quality_of
from services.mocap.fit.rim_matching import match_frames
from services.mocap.types import Mask

FEET = tuple(SEGMENT_INDEX[f"{side}_foot"] for side in ("left", "right"))


def about_feet(rig: Rig, person: Any) -> TriPlanes:
    """What is seen of a person whose feet and all about them are unsure."""
    drawn = CpuBackend(person.body, rig).coverage(person.poses, FEET, Region.whole(rig))
    kernel = np.ones((11, 11), np.uint8)

    def wide(mask: Mask) -> Mask:
        return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)

    unsure = np.array([pack(np.array([wide(m) for m in unpack(p, rig.n_cameras)])) for p in drawn])
    return TriPlanes(person.seen.silhouettes & ~unsure, unsure)


def shank_m(actor: Actor) -> float:
    """From knee to ankle."""
    return float(np.linalg.norm(build_body(actor).offsets_m[JOINT_INDEX["left_ankle"]]))


def test_unsure_feet_do_not_shorten_a_shank(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(2, 1)
    feet = about_feet(rig, person)
    known, unsure, cut = (
        shank_m(fit_actor(rig, seen, Actor(height=1.7), person.guess).actor)
        for seen in (person.seen, feet, TriPlanes.sure(feet.silhouettes))
    )
    assert unsure == pytest.approx(known, abs=0.02)  # shanks of people of one height differ by as much
    assert cut < known - 0.03


def test_a_frame_without_any_outline_keeps_its_pose_and_does_not_change_the_body(
    rig: Rig, a_person: Callable[..., Any]
) -> None:
    person = a_person(2, 2)
    poses = np.tile(person.guess, (2, 1))
    seen = person.seen
    silhouettes, unsure = seen.silhouettes.copy(), np.zeros_like(seen.silhouettes)
    silhouettes[1], unsure[1] = 0, 0xFF
    with_it = fit_actor(rig, TriPlanes(silhouettes, unsure), Actor(height=1.7), poses)
    alone = fit_actor(rig, TriPlanes.sure(silhouettes[:1]), Actor(height=1.7), poses[:1])
    assert with_it.actor.height == pytest.approx(alone.actor.height, abs=0.01)
    np.testing.assert_allclose(with_it.poses[0], alone.poses[0], atol=0.05)
    np.testing.assert_allclose(with_it.poses[1, :6], poses[1, :6], atol=1e-6)


def test_contours_end_beside_unsure_pixels_and_nothing_is_matched_there(
    rig: Rig, a_person: Callable[..., Any]
) -> None:
    person = a_person(3, 1)
    contours = contours_of(rig, about_feet(rig, person), 250)[0]
    found = match_frames(person.body, person.poses[:1], rig, [contours])[0]
    for contour, matches in zip(contours, found, strict=True):
        assert contour.near_unsure is not None
        assert contour.points_px[:, 1].max() < np.nonzero(contour.near_unsure)[0].max() - 5
        assert np.abs(matches.residuals_px).max() < 1.5


def test_without_unsure_pixels_a_contour_is_what_it_was() -> None:
    y, x = np.mgrid[:240, :320]
    disc = np.hypot(x - 150.3, y - 118.7) < 60.25
    plain, told = Contour.of(disc, 1.0, 100), Contour.of(disc, 1.0, 100, np.zeros_like(disc))
    np.testing.assert_array_equal(plain.points_px, told.points_px)
    assert told.near_unsure is None
    half = Contour.of(disc, 1.0, 100, x < 150)
    assert half.points_px[:, 0].min() > 151
    assert half.length_px == pytest.approx(plain.length_px / 2, rel=0.05)


def test_quality_leaves_them_out(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(6, 1)
    found = quality_of(person.body, person.poses, rig, about_feet(rig, person))
    assert np.all(found.iou == 1.0)
    assert found.energy_px[0] == 0
