"""`xormocap play`: what a tool hears of finished results."""

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_humanoid import places_of
from vmc_tool import Tool

from services.bridge.humanoid import BONES, Bone
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.result.result import load_result

pytestmark = pytest.mark.timeout(120)


def _start(*arguments: object) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "services.cli", "play", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_every_frame_is_heard_at_the_takes_speed_with_its_mark(tool: Tool, bare_result: Path) -> None:
    result = load_result(bare_result)
    process = _start(
        bare_result, "--vmc", f"127.0.0.1:{tool.port}", "--speed", 0.1
    )  # a busy machine is late for faster ones
    while not tool.oks():
        assert process.poll() is None
        time.sleep(0.001)
    began_s = time.monotonic()
    said, problem = process.communicate(timeout=60)
    lasted_s = time.monotonic() - began_s
    assert (process.returncode, problem) == (0, "")
    assert said.splitlines()[-1] == "sent 16 frames"
    assert lasted_s > 15 / 29.97 / 0.1 - 0.1
    frames = tool.frames()
    np.testing.assert_allclose(list(frames), np.arange(16) / 29.97, atol=1e-3)
    joints_m = result.motion.T_world_joint[..., :3, 3][:, [JOINT_INDEX[joint] for joint in BONES]]
    for bones, expected_m in zip(frames.values(), joints_m, strict=True):
        in_unity = np.column_stack([-expected_m[:, 1], expected_m[:, 2], expected_m[:, 0]])
        np.testing.assert_allclose(list(places_of(bones).values()), in_unity, atol=1e-3)
    trusted = [ok[3] for ok in tool.oks()[:-1]]
    assert trusted == [1, 1, 1, 0, *[1] * 12]
    assert tool.oks()[-1] == (0, 3, 0, 0)


def test_a_loop_goes_on_until_it_is_stopped(tool: Tool, bare_result: Path) -> None:
    process = _start(bare_result, "--vmc", f"127.0.0.1:{tool.port}", "--speed", 4, "--loop")
    deadline_s = time.monotonic() + 60
    while len(tool.frames()) < 40:
        assert process.poll() is None and time.monotonic() < deadline_s
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    assert process.wait(10) == 0
    times_s = list(tool.frames())
    assert times_s == sorted(times_s), "the time goes on where the take begins again"
    rounds = [_rounds_of(row, tool.frames()) for row in range(16)]  # a busy machine leaves out late frames
    assert max(map(len, rounds)) > 1
    assert all(bones == of_row[0] for of_row in rounds for bones in of_row)
    assert tool.oks()[-1] == (0, 3, 0, 0)


def _rounds_of(row: int, frames: dict[float, list[Bone]]) -> list[list[Bone]]:
    """What was heard of one frame of the take, round after round."""
    return [bones for time_s, bones in frames.items() if round(time_s * 29.97) % 16 == row]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("RESULT", "--vmc", "nowhere"), "--vmc nowhere: expected HOST:PORT"),
        (("/nowhere", "--vmc", "127.0.0.1:39539"), "/nowhere: is not a folder"),
        (("TAKE", "--vmc", "127.0.0.1:39539"), "is a take without results: type xormocap track"),
    ],
)
def test_bad_input_ends_in_one_sentence(
    arguments: tuple[str, ...], expected: str, bare_result: Path, tmp_path: Path
) -> None:
    take = tmp_path / "take"
    take.mkdir()
    (take / "take.toml").write_text("")
    places = {"RESULT": bare_result, "TAKE": take}
    process = _start(*(places.get(word, word) for word in arguments))
    said, problem = process.communicate(timeout=60)
    assert (process.returncode, said) == (2, "")
    assert expected in problem and len(problem.splitlines()) == 1


def test_a_result_of_one_frame(tool: Tool, bare_result: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(bare_result, tmp_path / "one"))
    lines = (folder / "poses.csv").read_text().splitlines()
    (folder / "poses.csv").write_text("\n".join(lines[:2]) + "\n")
    process = _start(folder, "--vmc", f"127.0.0.1:{tool.port}")
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 0 and "sent 1 frames" in said
