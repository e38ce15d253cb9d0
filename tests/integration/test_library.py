"""Tracking from Python, in one process: the very poses of the services."""

from pathlib import Path

import numpy as np
import pytest

from services.library import open_take, track, write_result
from services.mocap.errors import UserError
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import read_actor
from services.mocap.types import Floats


def test_one_process_finds_and_writes_what_the_services_do(
    tracked: Path, synthetic_take: Path, tmp_path: Path
) -> None:
    take, actor = open_take(synthetic_take), read_actor(tracked / "actor.toml")
    frames = track(take, actor, range(14, 20), search=SearchSettings(search_limbs="always"))
    result = write_result(tmp_path / "result", take, actor, frames, formats=("bvh", "trc"))
    for name in ("poses.csv", "poses_smooth.csv", "joints.csv", "actor.toml", "motion.bvh", "motion.trc"):
        assert (tmp_path / "result" / name).read_bytes() == (tracked / name).read_bytes(), name
    assert result.frames.tolist() == list(range(14, 20))


def _first_pose(synthetic_take: Path, first_pose: Floats | None) -> Floats:
    take = open_take(synthetic_take)
    tracked = track(take, read_actor(synthetic_take / "actor.toml"), range(3, 4), first_pose)
    return next(tracked).solution.pose


def test_a_first_pose_may_be_told(synthetic_take: Path) -> None:
    found = _first_pose(synthetic_take, None)
    np.testing.assert_allclose(_first_pose(synthetic_take, found), found, atol=0.02)


def test_frames_that_are_not_there_are_refused(synthetic_take: Path) -> None:
    take = open_take(synthetic_take)
    with pytest.raises(UserError, match=r"20, 30.*0:24"):
        next(track(take, read_actor(synthetic_take / "actor.toml"), range(20, 30)))
