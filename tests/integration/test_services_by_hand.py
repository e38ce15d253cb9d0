"""The services started one by one, as the README shows it."""

import time
from pathlib import Path

import numpy as np
import pytest
from busy import BUSY, ONE_WAY

from services.mocap.types import Floats
from services.runs.launcher import Launcher, free_endpoint

pytestmark = pytest.mark.timeout(280)


def test_two_camera_groups_and_late_workers_give_nearly_the_same_poses(
    synthetic_take: Path, one_way: Path, tmp_path: Path
) -> None:
    take, out = ("--take", str(synthetic_take)), tmp_path / "out"
    endpoint = free_endpoint()
    connect, expected = ("--connect", endpoint), ("--frames", "14:17", "--recorders", "1")
    with Launcher(tmp_path) as launcher:
        launcher.start("recorder", *take, *connect, "--out", str(out), "--no-overlay", "--no-report")
        launcher.start("segmentation", *take, *connect, "--cameras", "cam04,cam01")
        launcher.start("segmentation", *take, *connect, "--cameras", "cam02,cam03,cam05")
        launcher.start("coordinator", *take, "--bind", endpoint, *expected, *BUSY, *ONE_WAY)
        launcher.start("limb_worker", *connect, copies=2)
        deadline_s = time.monotonic() + 120
        while not launcher.has_ended("recorder") and time.monotonic() < deadline_s:
            launcher.watch()
            time.sleep(0.1)
    found, whole = _joints_m(out), _joints_m(one_way)[:3]
    assert found.shape == whole.shape
    assert np.median(np.abs(found - whole)) < 0.01  # cameras help each other within a group only


def _joints_m(result: Path) -> Floats:
    """(F, 3 J) of a result's joints.csv."""
    return np.loadtxt(result / "joints.csv", delimiter=",", skiprows=1)[:, 2:]
