"""A take and its fit, for the tests of fits."""

from pathlib import Path

import pytest

from replaced_fit import fit_by, stretch, write_walk
from services.mocap.take.folder import open_take
from services.runs.fit import init_frames
from services.runs.take_fit import TakeFit


@pytest.fixture(scope="session")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take whose first pose is said."""
    return write_walk(tmp_path_factory.mktemp("fit") / "walk")


@pytest.fixture(scope="session")
def walk_fit(walk: Path) -> TakeFit:
    shown: list[tuple[str, float]] = []
    take = open_take(walk)
    found = fit_by(stretch, take, init_frames(take), show=lambda *step: shown.append(step))
    shares = [share for _, share in shown]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] < 1.0
    return found
