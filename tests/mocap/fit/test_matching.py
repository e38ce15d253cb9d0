"""Contours, rims, their matches, and how these move with pose and shape."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from services.mocap.body.kinematics import N_DOF, segment_transforms
from services.mocap.body.shape_space import PARAMETERS, body_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.fit.contours import Contour, contours_of
from services.mocap.fit.jacobian import ShapeSlopes, jacobians
from services.mocap.fit.matching import Matches, backend_for, match_frame
from services.mocap.fit.rim import find_rims, project
from services.mocap.types import Floats

_ALL = tuple(range(len(PARAMETERS)))


def test_a_discs_contour_lies_on_its_circle_and_faces_outwards() -> None:
    y, x = np.mgrid[:240, :320]
    centre, radius = np.array([150.3, 118.7]), 60.25
    contour = Contour.of(np.hypot(x - centre[0], y - centre[1]) < radius, 1.0, 100)
    away = contour.points_px - centre
    distance = np.linalg.norm(away, axis=1)
    assert np.abs(distance - radius).max() < 0.5
    assert abs(distance.mean() - radius) < 0.05
    assert np.einsum("ni,ni->n", away / distance[:, None], contour.normals).min() > 0.97
    assert abs(contour.length_px / (2 * np.pi * radius) - 1.0) < 0.02
    assert len(contour.chosen) == 100


def test_what_touches_the_picture_s_border_has_no_contour_there() -> None:
    silhouette = np.zeros((240, 320), bool)
    silhouette[100:, 100:200] = True
    points_px = Contour.of(silhouette, 1.0, 100).points_px
    assert points_px[:, 1].max() <= 237
    assert Contour.of(np.ones((240, 320), bool), 1.0, 100).length_px == 0.0
    assert Contour.of(np.zeros((240, 320), bool), 1.0, 100).length_px == 0.0


def test_the_rim_is_the_outline_of_the_whole_silhouette(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(0, 1)
    masks = unpack(person.silhouettes[0], rig.n_cameras)
    rims = find_rims(person.body, person.poses[0], rig, person.silhouettes[0])
    for mask, rim in zip(masks, rims, strict=True):
        outline = np.zeros(mask.shape, np.uint8)
        contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        outline[tuple(np.vstack(contours)[:, 0, ::-1].T)] = 1
        away_px = cv2.distanceTransform(1 - outline, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        x, y = np.rint(rim.points_px).astype(int).T
        assert away_px[y, x].max() < 2.5
        length_px = len(np.vstack(contours))
        assert 0.8 < rim.lengths_px.sum() / length_px < 1.6


def test_the_right_pose_leaves_only_the_pixels_rounding(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(0, 1)
    contours = contours_of(rig, person.silhouettes, 250)[0]
    matches = match_frame(person.body, backend_for(person.body, rig), person.poses[0], rig, contours)
    residuals_px = np.concatenate([view.residuals_px for view in matches])
    assert abs(float(np.median(residuals_px))) < 0.1
    assert float(np.sqrt(np.mean(residuals_px**2))) < 0.6


def test_slopes_are_those_of_the_residuals(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(1, 1)
    x, pose = person.x * 0.5, person.guess
    body = body_of(x)
    contours = contours_of(rig, person.silhouettes, 50)[0]
    matches = match_frame(body, backend_for(body, rig), pose, rig, contours)
    by_pose, by_shape = jacobians(ShapeSlopes.at(x, _ALL), pose, rig, matches)
    rng, step = np.random.default_rng(0), 1e-5
    for _ in range(5):
        dx, dpose = rng.normal(size=len(x)), rng.normal(size=N_DOF)
        ahead = _residuals_px(x + step * dx, pose + step * dpose, rig, matches)
        behind = _residuals_px(x - step * dx, pose - step * dpose, rig, matches)
        expected = (ahead - behind) / (2 * step)
        assert np.abs(by_pose @ dpose + by_shape @ dx - expected).max() < 0.002 * np.abs(expected).max()


def _residuals_px(x: Floats, pose: Floats, rig: Rig, matches: list[Matches]) -> Floats:
    """All views' residuals with the same matches for another shape and pose, less a constant each."""
    body = body_of(x)
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    placed = zip(body.vertices_m, T_world_segment, strict=True)
    vertices_world_m = np.vstack([v @ T[:3, :3].T + T[:3, 3] for v, T in placed])
    residuals_px = []
    for view, P_px_world in zip(matches, rig.P_px_world, strict=True):
        points_px, _ = project(vertices_world_m[view.edges].mean(axis=1), P_px_world)
        residuals_px.append(np.einsum("ni,ni->n", view.normals, points_px - view.points_px))
    return np.concatenate(residuals_px)
