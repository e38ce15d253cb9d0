"""How a person's outline differs from the generic body's along each bone: factors on width and depth.

Factors are given at control points evenly spaced from a segment's near to its far end. They are the control
values of a Bézier curve: smooth, never above the largest nor below the smallest, equal to the first and the
last at the ends, straight if they lie on a line. Beyond an end the factor is constant, or follows the next
segment's profile if that continues in the same direction. At the hips, where two thighs meet the pelvis,
thigh and pelvis are blended, so that there is no step.
"""

from functools import lru_cache
from math import comb

import numpy as np

from services.mocap.body.body_mesh import SegmentMesh
from services.mocap.body.bones import smoothstep
from services.mocap.body.segment_row import Section
from services.mocap.body.skeleton_table import ROWS
from services.mocap.errors import FrozenModel
from services.mocap.types import Floats, Ints

FACTOR_RANGE = (0.3, 3.0)
"""Range of factors; people are well inside it."""
MOST_CONTROLS = 6
_FORMS_KEPT = 128
"""Number of cached segment forms."""


class Profile(FrozenModel):
    """Factors on a segment's extent across its bone, 1 being the generic body at the actor's height."""

    width: tuple[float, ...] = (1.0,)
    """At control points along the bone, from side to side of the body (see SECTIONS for arms and hands)."""
    depth: tuple[float, ...] = (1.0,)
    """The same for the extent in depth; there may be more or fewer of them."""


_GENERIC = Profile()
SECTIONS: dict[str, Section] = {row.name: row.section for row in ROWS}
"""Segment (without its side) -> how it lies in its frame on the left."""
_CONTINUES = {row.name: row.continued_by for row in ROWS if row.continued_by is not None}
"""Segments whose bone continues straight in another segment in the rest pose."""
_CONTINUED = {after: before for before, after in _CONTINUES.items()}
_AT_THE_HIPS = ("pelvis", "thigh")
SHAPED_BY: dict[str, tuple[str, ...]] = {
    segment: tuple(
        name
        for name in SECTIONS
        if name in (segment, _CONTINUES.get(segment), _CONTINUED.get(segment))
        or (segment in _AT_THE_HIPS and name in _AT_THE_HIPS)
    )
    for segment in SECTIONS
}
"""Segment (without its side) -> the segments whose profiles shape it."""
_CROTCH_POSITION = -0.38
"""Where along its bone the pelvis has become as deep as the thighs that come out of it."""
_HAUNCH_POSITION = 0.60
"""Where along the thigh its outer half has its own width again, which at the hip makes one outline with the
pelvis."""
_SHALLOWEST_FOOT = 0.01
"""Of a form's ankle over its sole, in body heights."""
_HAUNCH_POWER = 1.9
"""Of the pelvis' factor at the hips, for that outline: the pelvis is scaled about the middle of the body,
half a thigh about the hip joint. Any power keeps widths positive; this is nearest to one outline."""


def check_profiles(profiles: object) -> object:
    """The profiles of a file; raises ValueError for the first error in them."""
    if not isinstance(profiles, dict):
        raise ValueError("expected a table per segment, such as [profiles.torso]")
    for segment, profile in profiles.items():
        if segment not in SECTIONS:
            raise ValueError(f"{segment} is not a segment; known are {', '.join(SECTIONS)}")
        fields = dict(profile) if isinstance(profile, dict | Profile) else None
        if fields is None or not set(fields) <= {"width", "depth"}:
            raise ValueError(f"{segment}: expected only width and depth, each a list of factors")
        for name, factors in fields.items():
            _check_factors(f"{segment}.{name}", factors)
    return profiles


def _check_factors(where: str, factors: object) -> None:
    low, high = FACTOR_RANGE
    if not isinstance(factors, list | tuple) or not 1 <= len(factors) <= MOST_CONTROLS:
        raise ValueError(f"{where}: expected a list of 1 to {MOST_CONTROLS} factors")
    for factor in factors:
        is_number = isinstance(factor, int | float) and not isinstance(factor, bool)
        if not is_number or not low <= factor <= high:
            raise ValueError(
                f"{where}: expected factors from {low} to {high}, 1 being the generic body, found {factor!r}"
            )


def bezier_weights(positions: Floats, n_controls: int) -> Floats:
    """Weights (N, n_controls) of control values at positions (N,) from 0 to 1; outside, those of the end."""
    t, k = np.clip(positions, 0.0, 1.0)[:, None], np.arange(n_controls)
    counts = np.array([comb(n_controls - 1, i) for i in range(n_controls)])
    return counts * t**k * (1.0 - t) ** (n_controls - 1 - k)


def factors_along(
    segment: str, extent: str, profiles: dict[str, Profile], form: SegmentMesh
) -> Floats | float:
    """Factor of every vertex (V,) of a segment (without its side), or 1 where no profile touches it.

    extent: "width" or "depth". form: the segment, on the left if there are two. All factors are exactly 1
    where all controls are.
    """
    own = _controls(segment, extent, profiles)
    factors: Floats | float = 1.0
    if own is not None:  # differences from 1, so that rounding leaves the generic body as it is
        factors = 1.0 + _weights(form, segment, len(own)) @ (own - 1.0)
    for neighbour, at, end in ((_CONTINUED.get(segment), 0, -1), (_CONTINUES.get(segment), 1, 0)):
        controls = None if neighbour is None else _controls(neighbour, extent, profiles)
        if controls is not None:
            beyond, weights = _beyond(form, segment, at, len(controls))
            factors = np.broadcast_to(factors, (len(form.vertices_heights),)).copy()
            factors[beyond] *= (1.0 + weights @ (controls - 1.0)) / controls[end]
    if (segment, extent) == ("foot", "depth"):
        return 1.0 + (factors - 1.0) * _sole(form)
    if (segment, extent) == ("pelvis", "depth"):
        return factors * _into_thighs(form, profiles)
    return factors * _haunches(form, profiles) if (segment, extent) == ("thigh", "width") else factors


def _into_thighs(form: SegmentMesh, profiles: dict[str, Profile]) -> Floats:
    """What to multiply the pelvis' depths by, so that thighs of another depth come out without a step."""
    pelvis, thigh = (profiles.get(segment, _GENERIC).depth[0] for segment in _AT_THE_HIPS)
    share = smoothstep(_positions(form, "pelvis") / _CROTCH_POSITION)
    return 1.0 + share * (thigh / pelvis - 1.0)


@lru_cache(_FORMS_KEPT)
def _sole(form: SegmentMesh) -> Floats:
    """(V,) how much of the foot's depth every vertex takes: shoes are deep in the sole and thin elsewhere."""
    z_heights = form.vertices_heights[:, 2]  # 0 at the ankle
    return np.asarray(np.clip(z_heights / min(z_heights.min(), -_SHALLOWEST_FOOT), 0.0, 1.0))


def _haunches(form: SegmentMesh, profiles: dict[str, Profile]) -> Floats:
    """What to multiply the thigh's widths by, so that its outer side goes on in the pelvis' outline."""
    pelvis, thigh = (profiles.get(segment, _GENERIC).width[0] for segment in _AT_THE_HIPS)
    outer = form.vertices_heights[:, 1] > 0.0  # of the hip joint
    share = smoothstep(1.0 - _positions(form, "thigh") / _HAUNCH_POSITION) * outer
    widths: Floats = 1.0 + share * (pelvis**_HAUNCH_POWER / thigh - 1.0)
    return widths


def _controls(segment: str, extent: str, profiles: dict[str, Profile]) -> Floats | None:
    return np.array(getattr(profiles[segment], extent)) if segment in profiles else None


@lru_cache(_FORMS_KEPT)
def _positions(form: SegmentMesh, segment: str) -> Floats:
    """(V,) where along the bone the vertices lie: 0 at its first control point, 1 at its last."""
    section = SECTIONS[segment]
    along = form.vertices_heights[:, "xyz".index(section.axes[0])]
    return (along - section.start) / (section.end - section.start)


@lru_cache(_FORMS_KEPT)
def _weights(form: SegmentMesh, segment: str, n_controls: int) -> Floats:
    return bezier_weights(_positions(form, segment), n_controls)


@lru_cache(_FORMS_KEPT)
def _beyond(form: SegmentMesh, segment: str, at: int, n_controls: int) -> tuple[Ints, Floats]:
    """The vertices beyond an end (0 near, 1 far), and their weights in the neighbour's profile there."""
    neighbour = SECTIONS[(_CONTINUED, _CONTINUES)[at][segment]]
    section, positions = SECTIONS[segment], _positions(form, segment)
    beyond = np.flatnonzero(positions > 1.0 if at else positions < 0.0).astype(np.int32)
    length_ratio = (section.end - section.start) / (neighbour.end - neighbour.start)
    across_the_end = (positions[beyond] - at) * length_ratio
    return beyond, bezier_weights(across_the_end + (1 - at), n_controls)
