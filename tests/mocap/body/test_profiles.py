"""Profiles: Bézier factors along a bone that meet at the joints, and clear complaints about bad ones."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.body_mesh import SegmentMesh, generic_segments
from services.mocap.body.bones import BONES
from services.mocap.body.profiles import (
    FACTOR_RANGE,
    MOST_CONTROLS,
    SECTIONS,
    Profile,
    bezier_weights,
    factors_along,
)
from services.mocap.body.skeleton import JOINT_INDEX, SEGMENT_INDEX
from services.mocap.body.skeleton_table import ROWS
from services.mocap.errors import TakeError, load_toml, validated
from services.mocap.types import Floats

FACTORS = st.lists(st.floats(*FACTOR_RANGE), min_size=1, max_size=MOST_CONTROLS).map(tuple)
PROFILES = st.dictionaries(st.sampled_from(list(SECTIONS)), st.builds(Profile, width=FACTORS, depth=FACTORS))


def form_of(segment: str) -> SegmentMesh:
    return generic_segments()[SEGMENT_INDEX[segment if segment in SEGMENT_INDEX else f"left_{segment}"]]


def mesh_of(segment: str) -> Floats:
    return form_of(segment).vertices_heights


def factors_of(segment: str, extent: str, profiles: dict[str, Profile]) -> Floats:
    """(V,) of the generic segment."""
    return np.asarray(factors_along(segment, extent, profiles, form_of(segment)))


@given(FACTORS, st.lists(st.floats(-1.0, 2.0), min_size=1, max_size=20))
def test_curve_stays_within_its_controls_and_starts_and_ends_with_them(
    controls: tuple[float, ...], at: list[float]
) -> None:
    factors = bezier_weights(np.array(at), len(controls)) @ controls
    assert np.all(factors >= min(controls) - 1e-12)
    assert np.all(factors <= max(controls) + 1e-12)
    ends = bezier_weights(np.array([0.0, 1.0]), len(controls)) @ controls
    np.testing.assert_array_equal(ends, [controls[0], controls[-1]])


@given(st.integers(2, MOST_CONTROLS), st.floats(0.0, 1.0))
def test_controls_on_a_line_give_that_line(n_controls: int, at: float) -> None:
    controls = np.linspace(0.8, 1.4, n_controls)
    assert bezier_weights(np.array([at]), n_controls)[0] @ controls == pytest.approx(0.8 + 0.6 * at)


@pytest.mark.parametrize("segment", SECTIONS)
def test_sections_are_those_of_the_lofts_and_the_bones(segment: str) -> None:
    loft = next(row.lofts[0] for row in ROWS if row.name == segment)
    assert SECTIONS[segment].axes == loft.axes
    length = abs(SECTIONS[segment].end - SECTIONS[segment].start)
    assert length == pytest.approx(BONES[segment].length_heights)


@given(PROFILES)
@settings(max_examples=50, deadline=None)
def test_factors_are_positive_and_no_larger_than_neighbouring_controls_make_them(
    profiles: dict[str, Profile],
) -> None:
    low, high = FACTOR_RANGE
    for segment in SECTIONS:
        for extent in ("width", "depth"):
            factors = factors_of(segment, extent, profiles)
            assert np.all(np.isfinite(factors))
            assert np.all((factors >= low * low / high) & (factors <= high * high / low))


def test_generic_profiles_leave_every_bit_of_the_body() -> None:
    ones = {segment: Profile(width=(1.0,) * 4, depth=(1.0,) * 3) for segment in SECTIONS}
    body, same = build_body(Actor()), build_body(Actor(profiles=ones))
    for mine, others in zip(same.vertices_m, body.vertices_m, strict=True):
        np.testing.assert_array_equal(mine, others)


@pytest.mark.parametrize("segment", SECTIONS)
@pytest.mark.parametrize("extent", ["width", "depth"])
def test_one_factor_scales_the_whole_segment_in_one_direction(segment: str, extent: str) -> None:
    # All other segments get the factor too, as some follow their neighbours beyond their ends.
    profiles = {name: Profile.model_validate({extent: (1.25,)}) for name in SECTIONS}
    factors = np.broadcast_to(factors_of(segment, extent, profiles), len(mesh_of(segment)))
    haunches = (segment, extent) == ("thigh", "width")
    bulk = (mesh_of(segment)[:, 1] < 0) | (mesh_of(segment)[:, 2] < -0.151) if haunches else factors > 0
    if (segment, extent) == ("foot", "depth"):
        bulk = mesh_of(segment)[:, 2] == mesh_of(segment)[:, 2].min()  # the sole
    np.testing.assert_allclose(factors[bulk], 1.25)
    other = "depth" if extent == "width" else "width"
    np.testing.assert_array_equal(factors_of(segment, other, profiles), 1.0)


@pytest.mark.parametrize(
    ("before", "after"), [("pelvis", "torso"), ("upper_arm", "forearm"), ("thigh", "shank")]
)
def test_segments_that_share_a_joints_factor_have_one_curve_through_the_joint(
    before: str, after: str
) -> None:
    profiles = {
        before: Profile(width=(1.0, 1.3, 0.8), depth=(0.9, 1.2)),
        after: Profile(width=(0.8, 0.9, 1.4, 1.1), depth=(1.2, 1.0, 0.8)),
    }
    axis, bone = "xyz".index(SECTIONS[before].axes[0]), SECTIONS[before].end
    for extent in ("width", "depth"):
        for segment, start in ((before, 0.0), (after, bone)):
            along = mesh_of(segment)[:, axis] + start
            past = (along - bone) * np.sign(bone) > 0
            one, other = (np.array(getattr(profiles[name], extent)) for name in (before, after))
            curve = np.where(
                past,
                bezier_weights((along - bone) / SECTIONS[after].end, len(other)) @ other,
                bezier_weights(along / bone, len(one)) @ one,
            )
            curved = along * np.sign(bone) >= 0  # the pelvis goes on below its near end
            factors = factors_of(segment, extent, profiles)
            np.testing.assert_allclose(factors[curved], curve[curved], rtol=1e-12)


def test_a_deep_foot_is_deep_below_the_ankle_and_mostly_at_the_sole() -> None:
    z = mesh_of("foot")[:, 2]
    factors = factors_of("foot", "depth", {"foot": Profile(depth=(1.5,))})
    np.testing.assert_array_equal(factors[z >= 0], 1.0)
    assert np.all(np.diff((factors * z)[np.argsort(z)]) >= 0)
    np.testing.assert_allclose(factors[z < 0], 1.0 + 0.5 * z[z < 0] / z.min())


def test_the_pelvis_narrows_into_the_thighs() -> None:
    wide = {"pelvis": Profile(width=(1.5,), depth=(1.5,)), "thigh": Profile(width=(1.2,), depth=(1.2,))}
    z = mesh_of("pelvis")[:, 2]
    depths = factors_of("pelvis", "depth", wide)
    np.testing.assert_allclose(depths[z >= 0.0], 1.5)
    np.testing.assert_allclose(depths[z <= -0.045], 1.2)
    np.testing.assert_allclose(factors_of("pelvis", "width", wide), 1.5)


@pytest.mark.parametrize("factor", [0.8, 0.9, 1.0, 1.15, 1.3, 1.5])
@pytest.mark.parametrize("girth", [0.8, 1.0, 1.3])
def test_the_thighs_outer_side_goes_on_in_the_pelvis_outline(factor: float, girth: float) -> None:
    profiles = {"pelvis": Profile(width=(factor,)), "thigh": Profile(width=(girth,), depth=(girth,))}
    body = build_body(Actor(height=1.0, profiles=profiles))
    pelvis, thigh = (body.vertices_m[SEGMENT_INDEX[name]] for name in ("pelvis", "left_thigh"))
    hip_m = body.offsets_m[JOINT_INDEX["left_hip"], 1]
    at_hips, at_thigh = np.abs(pelvis[:, 2] - 0.012) < 0.01, np.abs(thigh[:, 2] + 0.018) < 0.01
    edges_m = pelvis[at_hips, 1].max(), hip_m + thigh[at_thigh, 1].max()
    assert edges_m[0] == pytest.approx(edges_m[1], abs=0.008)
    inner = thigh[:, 1] < 0
    generic = mesh_of("thigh")
    np.testing.assert_allclose(thigh[inner, 1], girth * generic[inner, 1])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("height = 175", "height: expected the standing height in metres, from 0.5 to 2.5, found 175"),
        ("bone_lengths = 3", "bone_lengths: expected a table of bones with lengths in metres, found 3"),
        ("[bone_lengths]\nthigh = 'x'", "bone_lengths: expected a table of bones with lengths in metres"),
        ("profiles = 1", "profiles: expected a table per segment, such as [profiles.torso]"),
        ("[profiles.belly]\nwidth = [1.2]", "profiles: belly is not a segment; known are pelvis, torso"),
        ("[profiles.torso]\ngirth = [1.2]", "profiles: torso: expected only width and depth"),
        ("[profiles]\ntorso = 1.2", "profiles: torso: expected only width and depth"),
        ("[profiles.torso]\nwidth = 1.2", "profiles: torso.width: expected a list of 1 to 6 factors"),
        ("[profiles.torso]\nwidth = []", "profiles: torso.width: expected a list of 1 to 6 factors"),
        ("[profiles.neck]\ndepth = [95]", "profiles: neck.depth: expected factors from 0.3 to 3.0, 1 being"),
        ("[profiles.neck]\ndepth = [nan]", "found nan"),
        ("[profiles.neck]\ndepth = [true]", "found True"),
        ("[profiles.neck]\ndepth = ['wide']", "found 'wide'"),
    ],
)
def test_bad_actor_files_get_one_clear_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "actor.toml"
    path.write_text(text)
    with pytest.raises(TakeError) as problem:
        validated(Actor, load_toml(path, TakeError), f"{path}: ", TakeError)
    assert f"{path}: " in str(problem.value)
    assert sentence in str(problem.value)
    assert "\n" not in str(problem.value)
