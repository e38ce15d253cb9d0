"""Contours, rims, their matches, and how these move with pose and shape."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from services.mocap.body.actor import Body
from services.mocap.body.garments import Skirt
from services.mocap.body.kinematics import N_DOF, surface_transforms
from services.mocap.body.shape_space import GENERIC_ACTOR, PARAMETERS, body_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.fit.contours import Contour, contours_of, nearest_facing, outline_of
from services.mocap.fit.jacobian import ShapeSlopes, jacobian
from services.mocap.fit.normal_equations import normal_sums
from services.mocap.fit.rim import PosedSurface, Rim
from services.mocap.fit.rim_matching import Matches, match_frames
from services.mocap.types import Floats

_ALL = tuple(range(len(PARAMETERS)))


def rims_of(body: Body, pose: Floats, rig: Rig) -> list[Rim]:
    """Every camera's rim."""
    surface = PosedSurface.of(body, pose)
    return [surface.rim(rig, c) for c in range(rig.n_cameras)]


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


def test_the_rim_is_the_outline_that_is_drawn(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(1, 1)
    masks = unpack(person.seen.silhouettes[0], rig.n_cameras)
    rims = rims_of(person.body, person.poses[0], rig)
    for mask, rim in zip(masks, rims, strict=True):
        points_px, normals = outline_of(mask)
        away_px, _ = cKDTree(points_px).query(rim.points_px)
        # Rules of two rasterisers differ where an outline meets a pixel's centre.
        assert np.mean(away_px < 0.1) > 0.95
        assert np.mean(away_px < 0.5) > 0.99
        assert np.abs(np.linalg.norm(rim.normals, axis=1) - 1.0).max() < 1e-6
        assert len(normals) == len(points_px)


def test_every_outline_point_has_a_surface_that_makes_it(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(1, 1)
    for rim in rims_of(person.body, person.poses[0], rig):
        edges = nearest_facing(rim.points_px, rim.normals, rim.middles_px, rim.facing, 3.0, 4.0)
        found = edges >= 0
        assert found.mean() > 0.97
        away_px = np.linalg.norm(rim.points_px[found] - rim.middles_px[edges[found]], axis=1)
        assert np.median(away_px) < 1.0
        assert np.median(np.einsum("ni,ni->n", rim.normals[found], rim.facing[edges[found]])) > 0.9


def test_the_nearest_of_points_that_face_alike_is_found() -> None:
    rng = np.random.default_rng(0)

    def some(n: int) -> tuple[Floats, Floats]:
        angles_rad = rng.uniform(0.0, 2.0 * np.pi, n)
        return rng.uniform(0.0, 50.0, (n, 2)), np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])

    points_px, normals = some(200)
    others_px, facing = some(300)
    away_px, nearest = cKDTree(np.hstack([others_px, 5.0 * facing])).query(
        np.hstack([points_px, 5.0 * normals])
    )
    assert np.array_equal(nearest_facing(points_px, normals, others_px, facing, 5.0, np.inf), nearest)
    within = nearest_facing(points_px, normals, others_px, facing, 5.0, 4.0)
    assert np.array_equal(within, np.where(away_px < 4.0, nearest, -1))
    assert 0 < np.count_nonzero(within < 0) < 200
    nobody = np.zeros((0, 2))
    assert np.all(nearest_facing(points_px, normals, nobody, nobody, 5.0, np.inf) == -1)


def test_who_reaches_a_camera_has_no_rim_there(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(1, 1)
    pose = person.poses[0].copy()
    P_px_world = rig.P_px_world[2]
    pose[:3] = -np.linalg.solve(P_px_world[:, :3], P_px_world[:, 3])
    counts = [len(rim.points_px) for rim in rims_of(person.body, pose, rig)]
    assert counts[2] == 0
    assert max(counts) > 100


def test_the_right_body_leaves_nothing_to_mend(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(1, 1)
    contours = contours_of(rig, person.seen, 250)[0]
    residuals_px = np.concatenate(
        [view.residuals_px for view in match_frames(person.body, person.poses[:1], rig, [contours])[0]]
    )
    assert np.mean(np.abs(residuals_px) < 0.01) > 0.9
    assert float(np.abs(residuals_px).mean()) < 0.01
    assert abs(float(residuals_px.mean())) < 2e-3


@pytest.mark.parametrize("skirt", [None, Skirt(length=0.35, flare=0.03)])
def test_slopes_are_those_of_the_surface(rig: Rig, a_person: Callable[..., Any], skirt: Skirt | None) -> None:
    person, base = a_person(1, 1), GENERIC_ACTOR.in_skirt(skirt)
    x, pose = person.x * 0.5, person.guess
    contours = contours_of(rig, person.seen, 50)[0]
    matches = match_frames(body_of(x, base), pose[None], rig, [contours])[0]
    rows = jacobian(ShapeSlopes.at(x, _ALL, base), pose, rig, matches)
    rng, step = np.random.default_rng(0), 1e-5
    for _ in range(5):
        dx, dpose = rng.normal(size=len(x)), rng.normal(size=N_DOF)
        ahead = _along_normals_px(body_of(x + step * dx, base), pose + step * dpose, rig, matches)
        behind = _along_normals_px(body_of(x - step * dx, base), pose - step * dpose, rig, matches)
        expected = (ahead - behind) / (2 * step)
        # The outline's points lie up to some pixels beside the middles of the edges that make them.
        assert np.abs(rows @ np.hstack([dpose, dx]) - expected).max() < 0.01 * np.abs(expected).max()


def test_sums_are_the_products_of_matrices() -> None:
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(50, 9)) * (rng.random((50, 9)) < 0.5)
    residuals, weights = rng.normal(size=50), rng.random(50)
    sums, slopes = normal_sums(rows, residuals, weights)
    assert np.allclose(sums, rows.T @ np.diag(weights) @ rows)
    assert np.allclose(slopes, rows.T @ (weights * residuals))


def _along_normals_px(body: Body, pose: Floats, rig: Rig, matches: list[Matches]) -> Floats:
    """Where along the normals the same edges' middles are for another body and pose."""
    placed = zip(body.surfaces, surface_transforms(pose[None], body.offsets_m)[0], strict=True)
    vertices_world_m = np.vstack([v @ T[:3, :3].T + T[:3, 3] for (v, _), T in placed])
    along_px = []
    for view, P_px_world in zip(matches, rig.P_px_world, strict=True):
        middles_m = vertices_world_m[view.edges].mean(axis=1)
        homogeneous = middles_m @ P_px_world[:, :3].T + P_px_world[:, 3]
        along_px.append(np.einsum("ni,ni->n", view.normals, homogeneous[:, :2] / homogeneous[:, 2:]))
    return np.concatenate(along_px)
