"""Charts: what they show of the known frames, and where they are shaded."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import DOF_NAMES
from services.viewer.charts import MOST_FRAMES, Charts
from services.viewer.frame_history import FrameHistory
from services.viewer.solved_frame import SolvedFrame

Make = Callable[..., SolvedFrame]


@pytest.fixture
def history(solved: Make) -> FrameHistory:
    history = FrameHistory(range(1000))
    for frame in range(50):
        history.put(solved(frame, distrusted=("left_leg",) if frame in (7, 8) else ()))
    return history


def test_quantities_are_drawn_of_all_known_frames(history: FrameHistory) -> None:
    charts = Charts(history, build_body(Actor()))
    drawn = charts.draw("Energy (differing pixels)")
    assert drawn is not None and drawn.frames.tolist() == list(range(50))
    np.testing.assert_allclose(drawn.values[:, 0], 100.0 + np.arange(50))
    assert np.flatnonzero(drawn.doubtful).tolist() == [7, 8]
    times = charts.draw("Milliseconds")
    assert times is not None and times.chart.names == ("whole body", "limbs", "head", "frame in all")
    np.testing.assert_allclose(times.values, 40)
    speed = charts.draw("Frames per second")
    assert speed is not None
    np.testing.assert_allclose(speed.values, 25)
    assert charts.draw("no such chart") is None


def test_angles_are_those_of_the_pose_and_shaded_where_their_limb_is_doubtful(
    history: FrameHistory, solved: Make
) -> None:
    bent = solved(50)
    bent.pose[:] = 0
    bent.pose[DOF_NAMES.index("left_knee_flexion")] = np.radians(40)
    history.put(bent)
    charts = Charts(history, build_body(Actor()))
    knees, elbows = (charts.draw(f"Angle: {joint} flexion (degrees)") for joint in ("knee", "elbow"))
    assert knees is not None and elbows is not None
    assert knees.chart.names == ("left", "right")
    np.testing.assert_allclose(knees.values[-1], [40, 0], atol=1e-6)
    assert np.flatnonzero(knees.doubtful).tolist() == [7, 8]
    assert not elbows.doubtful.any()


def test_a_doubtful_torso_shades_every_curve(history: FrameHistory, solved: Make) -> None:
    history.put(solved(50, distrusted=("torso",)))
    drawn = Charts(history, build_body(Actor())).draw("Angle: elbow flexion (degrees)")
    assert drawn is not None and np.flatnonzero(drawn.doubtful).tolist() == [50]


def test_delays_are_shown_where_they_were_measured(history: FrameHistory) -> None:
    charts = Charts(history, build_body(Actor()))
    charts.note_delay(40, 0.5)
    drawn = charts.draw("Delay of this page in seconds")
    assert drawn is not None
    assert np.flatnonzero(np.isfinite(drawn.values[:, 0])).tolist() == [40]


def test_before_the_first_frame_all_charts_are_empty() -> None:
    charts = Charts(FrameHistory(range(10 * MOST_FRAMES)), build_body(Actor()))
    for title in charts.titles:
        drawn = charts.draw(title)
        assert drawn is not None and drawn.values.shape == (0, len(drawn.chart.names)), title
