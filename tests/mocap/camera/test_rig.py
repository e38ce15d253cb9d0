"""The rig: what it takes from cameras, its JSON round trip, and what it refuses."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError

from services.mocap.camera.rig import Rig
from services.mocap.synth.studio import studio_cameras

FINITE = st.floats(allow_nan=False, allow_infinity=False)
RIGS = st.integers(1, 9).flatmap(
    lambda n: st.builds(
        Rig,
        arrays(np.float64, (n, 3, 4), elements=FINITE),
        arrays(np.int32, (n, 2), elements=st.integers(1, 16384)),
    )
)


def fields_of_a_rig() -> dict[str, Any]:
    fields: dict[str, Any] = json.loads(Rig.of(studio_cameras(2)).to_json())
    return fields


@given(RIGS)
def test_json_round_trip_is_exact(rig: Rig) -> None:
    back = Rig.from_json(rig.to_json())
    np.testing.assert_array_equal(back.P_px_world, rig.P_px_world)
    np.testing.assert_array_equal(back.sizes_px, rig.sizes_px)
    assert back.sizes_px.dtype == np.int32
    assert back.P_px_world.dtype == np.float64
    assert back.content_hash == rig.content_hash
    assert back.to_json() == rig.to_json()


def test_projects_as_its_cameras_do() -> None:
    cameras = studio_cameras(5)
    rig = Rig.of(cameras)
    assert rig.n_cameras == 5
    point_world_m = np.array([0.3, -0.2, 1.1])
    for camera, P_px_world in zip(cameras, rig.P_px_world, strict=True):
        u, v, depth_m = P_px_world @ np.append(point_world_m, 1.0)
        np.testing.assert_allclose([u / depth_m, v / depth_m], camera.project_px(point_world_m))


def test_shape_holds_every_picture() -> None:
    tall, wide = studio_cameras(1, 240, 400)[0], studio_cameras(1, 320, 200)[0]
    rig = Rig.of((tall, wide))
    assert rig.shape_px == (400, 320)
    np.testing.assert_array_equal(rig.sizes_px, [[240, 400], [320, 200]])


def test_hash_tells_rigs_apart() -> None:
    fields = fields_of_a_rig()
    hashes = {Rig.from_json(json.dumps(fields)).content_hash}
    fields["P_px_world"][1][2][3] += 1e-9
    hashes.add(Rig.from_json(json.dumps(fields)).content_hash)
    fields["sizes_px"][0][0] += 1
    hashes.add(Rig.from_json(json.dumps(fields)).content_hash)
    assert len(hashes) == 3


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), "3 m", None])
def test_what_is_no_finite_number_is_refused(value: float | str | None) -> None:
    fields = fields_of_a_rig()
    fields["P_px_world"][1][0][3] = value
    with pytest.raises(ValidationError, match=r"P_px_world\.1\.0\.3"):
        Rig.from_json(json.dumps(fields))


@pytest.mark.parametrize("size_px", [[0, 240], [320, -1], [320, 16385], [320], [320, 240, 3], [320.5, 240]])
def test_impossible_sizes_are_refused(size_px: list[float]) -> None:
    fields = fields_of_a_rig()
    fields["sizes_px"][1] = size_px
    with pytest.raises(ValidationError, match=r"sizes_px\.1"):
        Rig.from_json(json.dumps(fields))


@pytest.mark.parametrize("key", ["P_px_world", "sizes_px"])
def test_mismatched_counts_are_refused(key: str) -> None:
    fields = fields_of_a_rig()
    fields[key].pop()
    with pytest.raises(ValidationError, match="a projection and a size for every camera"):
        Rig.from_json(json.dumps(fields))


def test_no_camera_at_all_is_refused() -> None:
    with pytest.raises(ValidationError, match="at least one camera"):
        Rig.from_json('{"P_px_world": [], "sizes_px": []}')


@pytest.mark.parametrize("rows", [[], [[1.0, 0.0, 0.0, 0.0]] * 2, [[1.0, 0.0, 0.0]] * 3])
def test_other_shapes_are_refused(rows: list[list[float]]) -> None:
    fields = fields_of_a_rig()
    fields["P_px_world"][0] = rows
    with pytest.raises(ValidationError, match=r"P_px_world\.0"):
        Rig.from_json(json.dumps(fields))


@pytest.mark.parametrize("text", ["", "[]", "{", "null", '{"P_px_world": []}'])
def test_what_is_no_rig_is_refused(text: str) -> None:
    with pytest.raises(ValidationError):
        Rig.from_json(text)


def test_unknown_fields_are_refused() -> None:
    with pytest.raises(ValidationError, match="units"):
        Rig.from_json(json.dumps({**fields_of_a_rig(), "units": "m"}))
