"""Charts take turns, each about the frame that is shown, until all are about it."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import viser

from services.viewer.curves import Curves
from services.viewer.frame_history import FrameHistory, SolvedFrame


class _Gui:
    """Keeps what charts are given."""

    def __init__(self) -> None:
        self.charts: dict[str, SimpleNamespace] = {}

    def add_uplot(self, data: object, series: object, *, title: str, visible: bool, **_: Any) -> object:
        self.charts[title] = SimpleNamespace(data=data, series=series, visible=visible)
        return self.charts[title]

    def last_frames(self) -> dict[str, float]:
        """The last frame of each chart that is shown."""
        return {title: chart.data[0][-1] for title, chart in self.charts.items() if chart.visible}


def test_charts_are_drawn_one_at_a_time_and_no_more_than_once(solved: Callable[..., SolvedFrame]) -> None:
    gui, history = _Gui(), FrameHistory(range(1000))
    curves = Curves(cast(viser.GuiApi, gui), history)
    assert not curves.draw_next(0), "nothing is known"
    for frame in range(50):
        history.put(solved(frame))
    shown = []
    while curves.draw_next(49):
        shown.append(len(gui.last_frames()))
    assert shown == [1, 2, 3, 4, 5], "nobody has measured how far the page is behind"
    assert set(gui.last_frames().values()) == {49}
    assert not curves.draw_next(49)
    history.put(solved(50))
    for frame in (40, 41):
        curves.note_lag(frame, 0.5)
    while curves.draw_next(50):
        pass
    assert sorted(gui.last_frames().values()) == [41, 50, 50, 50, 50, 50]
    times = gui.charts["Milliseconds"]
    assert len(times.data) == len(times.series) == 6
    np.testing.assert_allclose(times.data[1], 40)
    np.testing.assert_allclose(gui.charts["Frames per second"].data[1], 25)
