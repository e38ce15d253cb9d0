import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.synth.choreography import Score

TIME_S = np.arange(0.0, 4.0, 1 / 240)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.floats(0.05, 1.0), st.floats(-100, 100)), min_size=1, max_size=8))
def test_stays_within_the_range_of_its_keys_without_jumps(keys: list[tuple[float, float]]) -> None:
    score, at_s, values = Score({"arm": 0.0}), 0.0, [0.0]
    for gap_s, value in keys:
        at_s += gap_s
        score.put(at_s, arm=value)
        values.append(value)
    played = score.play("arm", TIME_S)
    assert played.min() >= min(values) - 1e-9
    assert played.max() <= max(values) + 1e-9
    assert np.abs(np.diff(played)).max() <= 0.06 * max(1.0, np.ptp(values))


def test_holds_and_ends_at_its_last_key() -> None:
    score = Score({"arm": 0.0, "leg": 7.0})
    score.put(1.0, arm=5.0)
    score.hold(2.0, "arm")
    score.put(3.0, arm=-5.0)
    played = score.play("arm", TIME_S)
    np.testing.assert_allclose(played[(TIME_S > 1.2) & (TIME_S < 1.8)], 5.0, atol=1e-6)
    np.testing.assert_allclose(played[TIME_S > 3.2], -5.0, atol=1e-6)
    assert score.last("arm") == -5.0
    np.testing.assert_allclose(score.play("leg", TIME_S), 7.0, atol=1e-12)


def test_keys_go_on_in_time() -> None:
    score = Score({"arm": 0.0})
    score.put(1.0, arm=5.0)
    score.put(1.0, arm=6.0)  # in its place
    assert score.last("arm") == 6.0
    with pytest.raises(ValueError, match=r"arm: a key at 0\.500 s after one at 1.000 s"):
        score.put(0.5, arm=1.0)
