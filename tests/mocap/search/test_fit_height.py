"""The actor's height from silhouettes of a body whose height is known."""

from collections.abc import Callable
from pathlib import Path

import pytest

from services.mocap.energy.engine import open_engine
from services.mocap.energy.picture import Picture
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.first_frame import FirstFrameSearch
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Floats


@pytest.mark.parametrize("believed_m", [1.66, 1.83])
def test_the_height_is_found_from_a_wrong_one(
    model: Model,
    standing: Callable[..., Floats],
    picture_of: Callable[[Floats], Picture],
    believed_m: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And no body is thinned for it: each of them would be kept in the cache."""
    monkeypatch.setenv("XORMOCAP_CACHE", str(tmp_path))
    pose = standing(root_heading=40, shoulder_elevation=-60, hip_abduction=6, elbow_flexion=15)
    cpu = open_engine(EngineSettings(backend="cpu"))
    hints = TakeSettings(name="t", fps=15.0, units="m", up="z", frames=1)
    search = FirstFrameSearch(model.rig, hints, lambda tried, _: LocalLimbs(tried), cpu, SearchSettings())
    found_m = search.fit_height(picture_of(pose), pose, believed_m)
    assert abs(found_m - model.body.height_m) < 0.015
    assert list(tmp_path.iterdir()) == []
