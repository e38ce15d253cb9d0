import numpy as np
import pytest

from reference_rasteriser import rasterise
from services.mocap.body.actor import Body
from services.mocap.synth.raster import SAMPLES, draw
from services.mocap.synth.render import Model
from services.mocap.synth.studio import studio_cameras
from services.mocap.synth.walk import walk
from services.mocap.types import Floats, Ints, Mask

# Looks along +z from the origin: a point (x, y, 1) is seen at the pixel (x, y).
P_PX_WORLD = np.eye(3, 4)


def _tetrahedron(corners_world_m: Floats) -> tuple[Floats, Ints]:
    """A closed mesh (4, 3), (4, 3), counter-clockwise seen from outside."""
    faces = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], np.int32)
    a, b, c, d = corners_world_m
    if np.dot(np.cross(b - a, c - a), d - a) > 0:
        faces = faces[:, ::-1]
    return corners_world_m, faces


def _centre_mask(corners_world_m: Floats, faces: Ints, size_px: tuple[int, int]) -> Mask:
    layer = draw(corners_world_m, np.ones((len(corners_world_m), 3), np.float32), faces, P_PX_WORLD, size_px)
    mask = np.zeros(size_px[::-1], bool)
    height, width = layer.centre.shape
    mask[layer.y_px : layer.y_px + height, layer.x_px : layer.x_px + width] = layer.centre
    return mask


def test_pixel_centres_as_the_reference_rasteriser() -> None:
    rng = np.random.default_rng(1)
    drawn = 0
    for _ in range(300):
        x, y = np.round(rng.uniform(-6, 26, (2, 4)) * 4) / 4  # on a grid that hits many pixel centres exactly
        z = rng.uniform(0.5, 2.0, 4)
        vertices, faces = _tetrahedron(np.stack([x * z, y * z, z], axis=1))
        expected = rasterise(vertices, faces, P_PX_WORLD, 20, 16)
        np.testing.assert_array_equal(_centre_mask(vertices, faces, (20, 16)), expected)
        drawn += int(expected.any())
    assert drawn > 200


def test_the_body_as_the_reference_rasteriser(synth_body: Body) -> None:
    figure = Model(synth_body).pose(walk(60, 15, synth_body)[24])
    camera = studio_cameras()[2]
    layer = draw(figure.vertices_world_m, figure.bgr, figure.faces, camera.P_px_world, (320, 240))
    expected = rasterise(figure.vertices_world_m, figure.faces, camera.P_px_world, 320, 240)
    height, width = layer.centre.shape
    window = np.s_[layer.y_px : layer.y_px + height, layer.x_px : layer.x_px + width]
    np.testing.assert_array_equal(layer.centre, expected[window])
    assert layer.centre.sum() == expected.sum() > 900


def test_the_nearer_body_is_on_top() -> None:
    far, far_faces = _tetrahedron(2.0 * np.array([[0, 0, 1], [20, 0, 1], [0, 20, 1], [5, 5, 1.5]]))
    near, near_faces = _tetrahedron(np.array([[4, 4, 1], [9, 4, 1], [4, 9, 1], [5, 5, 1.5]]))
    vertices = np.concatenate([near, far])
    faces = np.concatenate([near_faces, far_faces + 4]).astype(np.int32)
    red, green = (np.tile(np.array(bgr, np.float32), (4, 1)) for bgr in ((0, 0, 255), (0, 255, 0)))
    for order in (faces, faces[::-1].copy()):
        layer = draw(vertices, np.concatenate([red, green]), order, P_PX_WORLD, (24, 24))
        np.testing.assert_allclose(layer.bgr[5, 5], [0, 0, 255], atol=1e-3)
        np.testing.assert_allclose(layer.bgr[2, 2], [0, 255, 0], atol=1e-3)


def test_coverage_is_the_area() -> None:
    vertices, faces = _tetrahedron(np.array([[0, 0, 1], [20.0, 0, 1], [0, 20.0, 1], [5, 5, 1.5]]))
    layer = draw(vertices, np.full((4, 3), 90.0, np.float32), faces, P_PX_WORLD, (24, 24))
    assert layer.coverage.sum() == pytest.approx(200, rel=0.05)
    np.testing.assert_allclose(layer.bgr, 90.0 * layer.coverage[..., None].repeat(3, axis=2), atol=1e-3)
    assert set(np.round(layer.coverage * SAMPLES**2).ravel()) <= set(range(SAMPLES**2 + 1))


def test_beside_the_picture_nothing_is_drawn() -> None:
    vertices, faces = _tetrahedron(np.array([[50, 0, 1], [70.0, 0, 1], [50, 20.0, 1], [55, 5, 1.5]]))
    layer = draw(vertices, np.ones((4, 3), np.float32), faces, P_PX_WORLD, (24, 24))
    assert not layer.coverage.any()


def test_behind_the_camera_nothing_is_drawn() -> None:
    vertices, faces = _tetrahedron(np.array([[0, 0, -1], [20.0, 0, -1], [0, 20.0, -1], [5, 5, -1.5]]))
    assert not _centre_mask(vertices, faces, (24, 24)).any()
