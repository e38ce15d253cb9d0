"""The bridge's process: what a tool that listens to VMC hears while a take is tracked."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from test_humanoid import places_of
from vmc_tool import Tool

from known_actor import write_take_of_known_actor
from patience import until
from playback import Playback
from services.bridge.humanoid import BONES
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.motion.smoothing import OneEuro
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import SETTINGS
from services.mocap.take.settings import read_take_file
from services.mocap.types import Floats
from services.runs.launcher import free_endpoint

pytestmark = pytest.mark.timeout(120)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Take:
    folder = tmp_path_factory.mktemp("bridge") / "walk"
    write_take_of_known_actor(folder, n_frames=24, n_cameras=3)
    return open_take(folder)


Bridge = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture
def start_bridge(tool: Tool, tmp_path: Path) -> Iterator[Bridge]:
    """`start_bridge(playback, …)`: the process, connected with both."""
    running: list[subprocess.Popen[bytes]] = []

    def start(playback: Playback, *more: str) -> "subprocess.Popen[bytes]":
        where = ("--connect", playback.endpoint, "--vmc", f"127.0.0.1:{tool.port}")
        command = [sys.executable, "-m", "services.bridge", *where, *more]
        with (tmp_path / "bridge.log").open("wb") as log:
            running.append(subprocess.Popen(command, stdout=log, stderr=log))
        return running[-1]

    yield start
    for process in running:
        process.terminate()
        process.wait(20)


def _expected(take: Take, pose: Floats) -> Floats:
    """(S, 3) our joints in Unity's axes."""
    height = read_take_file(take.folder / SETTINGS).actor_height
    joints_m = joint_positions(pose[None], build_body(Actor(height=height)).offsets_m)[0]
    joints_m = joints_m[[JOINT_INDEX[joint] for joint in BONES]]
    return np.column_stack([-joints_m[:, 1], joints_m[:, 2], joints_m[:, 0]])


def test_a_tool_hears_the_tracked_poses(walk: Take, tool: Tool, start_bridge: Bridge) -> None:
    with Playback(walk, free_endpoint(), period_s=0.05) as playback:
        process = start_bridge(playback, "--cutoff-hz", "0")
        until(lambda: len(tool.frames()) > 5, "no frame was heard")
        playback.distrusted = ["left_arm"]
        until(lambda: (1, 3, 0, 0) in tool.oks(), "nobody says that a frame is not to be trusted")
        for time_s, bones in tool.frames().items():
            pose = playback.pose(round(time_s * walk.settings.fps)).pose
            found = np.array(list(places_of(bones).values()))
            np.testing.assert_allclose(found, _expected(walk, pose), atol=1e-3)
    assert (1, 3, 0, 1) in tool.oks()
    n_frames = len(tool.frames())
    until(lambda: tool.oks()[-1] == (0, 3, 0, 0), "nobody says that nothing comes any more")
    assert len(tool.frames()) >= n_frames
    process.terminate()
    assert process.wait(20) == 143


def test_the_end_of_a_take_is_told_and_poses_are_smoothed(
    walk: Take, tool: Tool, start_bridge: Bridge
) -> None:
    with Playback(walk, free_endpoint(), frames=48, waits=True) as playback:
        start_bridge(playback, "--cutoff-hz", "1.5")
        until(lambda: (1, 3, 0, 1) in tool.oks(), "no frame was heard")
        until(lambda: tool.oks()[-1] == (0, 3, 0, 0), "the end is not told")
        frames, one_euro = tool.frames(), OneEuro(1.5)
        for time_s, bones in frames.items():
            message = playback.pose(round(time_s * walk.settings.fps))
            expected = _expected(walk, one_euro(message.pose, message.time_s))
            np.testing.assert_allclose(list(places_of(bones).values()), expected, atol=1e-3)
    assert max(frames) == pytest.approx(47 / walk.settings.fps, abs=1e-3)


def test_another_take_is_left_out(walk: Take, tool: Tool, start_bridge: Bridge) -> None:
    with Playback(walk, free_endpoint(), period_s=0.02) as playback:
        start_bridge(playback, "--take", "another")
        until(lambda: len(tool.oks()) > 2, "the bridge says nothing")
        assert tool.frames() == {}
        assert set(tool.oks()) == {(0, 3, 0, 0)}
