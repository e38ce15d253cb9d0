"""Measures of a body as a tape would find them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.measures import measure
from services.mocap.body.profiles import Profile

# Fifth percentile of women to the 95th of men in the 2012 US Army survey (NATICK/TR-15/007), over stature.
PEOPLE_SHARES = {
    "height": (1.0, 1.0),
    "arm span": (0.96, 1.10),
    "shoulder width": (0.20, 0.26),
    "hip width": (0.18, 0.24),
    "inside leg": (0.43, 0.50),
    "hand": (0.100, 0.118),
    "foot": (0.142, 0.162),
    "chest girth": (0.48, 0.66),
    "waist girth": (0.42, 0.64),
    "hip girth": (0.53, 0.66),
    "thigh girth": (0.31, 0.41),
    "calf girth": (0.20, 0.25),
    "upper arm girth": (0.16, 0.22),
    "forearm girth": (0.14, 0.19),
    "head girth": (0.31, 0.36),
}


def _cm(actor: Actor) -> dict[str, float]:
    return {row.name: row.cm for row in measure(build_body(actor))}


def test_the_generic_body_is_like_people() -> None:
    cm = _cm(Actor(height=1.72))
    assert cm["height"] == pytest.approx(172.0, abs=0.3)
    for name, (low, high) in PEOPLE_SHARES.items():
        assert low - 0.002 <= cm[name] / 172.0 <= high + 0.002, name


@settings(max_examples=5)
@given(st.floats(1.2, 2.2))
def test_all_measures_grow_with_height(height_m: float) -> None:
    small, tall = _cm(Actor(height=1.0)), _cm(Actor(height=height_m))
    assert list(tall.values()) == pytest.approx([cm * height_m for cm in small.values()], rel=1e-6)


def test_limbs_are_as_long_as_their_bones() -> None:
    cm = _cm(Actor(bone_lengths={"upper_arm": 0.31, "forearm": 0.27, "thigh": 0.44, "shank": 0.39}))
    assert [cm[name] for name in ("upper arm", "forearm", "thigh", "shank")] == pytest.approx(
        [31, 27, 44, 39]
    )


def test_a_girth_is_the_perimeter_of_the_section() -> None:
    """A profile that scales width and depth alike scales the girth there as much, and no other's."""
    plain, fat = _cm(Actor()), _cm(Actor(profiles={"shank": Profile(width=(1.2,), depth=(1.2,))}))
    assert fat["calf girth"] == pytest.approx(1.2 * plain["calf girth"], rel=1e-3)
    others = [name for name in plain if name != "calf girth"]
    assert [fat[name] for name in others] == pytest.approx([plain[name] for name in others])


def test_a_tape_round_the_trunk_leaves_the_arms_out() -> None:
    plain = _cm(Actor())
    for segment in ("upper_arm", "forearm", "hand"):
        stout = _cm(Actor(profiles={segment: Profile(width=(1.5,), depth=(1.5,))}))
        for name in ("chest girth", "waist girth", "hip girth", "shoulder width", "hip width"):
            assert stout[name] == pytest.approx(plain[name])


def test_every_measure_says_how_to_take_it() -> None:
    rows = measure(build_body(Actor()))
    assert len({row.name for row in rows}) == len(rows)
    assert all(row.how and np.isfinite(row.cm) and row.cm > 0 for row in rows)
