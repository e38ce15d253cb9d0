"""What `xormocap live` says before the work where a source or the page's port cannot be had."""

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from services.mocap.camera.calibration import write_calibration
from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.take.writer import video_writer
from services.runs.launcher import free_port

_GOOD = '"cam.mp4"'
_ELSEWHERE = 'elsewhere = ["left"]\nendpoint = "tcp://127.0.0.1:5550"\n'


@pytest.fixture
def stage(tmp_path: Path, small_cameras: Callable[[int], list[Camera]]) -> Path:
    """A folder with the calibration of three cameras and a video that fits each of them."""
    write_calibration(tmp_path / "calibration.toml", tuple(small_cameras(3)), "z")
    with video_writer(tmp_path / "cam.mp4", 64, 48, 10.0) as video:
        video.write(np.zeros((48, 64, 3), np.uint8))
    (tmp_path / "broken.mp4").write_bytes(b"no video")
    return tmp_path


@pytest.fixture
def taken() -> Iterator[int]:
    """A port on which somebody listens."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        yield listening.getsockname()[1]


def said_of(
    stage: Path, refused: Callable[..., str], sources: list[str], *options: object, head: str = _ELSEWHERE
) -> str:
    """What the command says of these sources; cam01 is of the group "left", by default on another host."""
    groups = ("left", "right", "right")
    (stage / "live.toml").write_text(
        'name = "stage"\nfps = 10.0\nup = "z"\ncalibration = "calibration.toml"\n'
        + head
        + "".join(
            f'[cameras.cam0{n}]\nsource = {source}\ngroup = "{group}"\n'
            for n, (source, group) in enumerate(zip(sources, groups, strict=True), 1)
        )
    )
    began_s = time.monotonic()
    said = refused("live", stage / "live.toml", "--out", stage / "out", *options)
    assert time.monotonic() - began_s < 10
    assert not (stage / "out").exists()
    return said


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ('"gone.mp4"', "gone.mp4 is missing: correct the path"),
        ('"broken.mp4"', "broken.mp4: cannot be read as a video"),
        ("249", "/dev/video249 is missing: connect the camera, or give the number of another device"),
        ('"http://127.0.0.1:99999/1"', "expected an address such as rtsp://HOST:PORT/PATH"),
        ('"rtsp://user:secret@a..b/1"', "rtsp://a..b/1: expected an address such as rtsp://HOST:PORT/PATH"),
    ],
    ids=["file", "damaged file", "device", "port", "host"],
)
def test_a_source_that_is_not_there_is_named_with_its_camera(
    stage: Path, refused: Callable[..., str], taken: int, source: str, said: str
) -> None:
    """Of the cameras of this host: cam01, which another one serves, is missing as well."""
    sentence = said_of(stage, refused, ["7777", f'"http://127.0.0.1:{taken}/2"', source])
    assert sentence.startswith("[cameras.cam03] source: ")
    assert said in sentence
    assert "\n" not in sentence
    assert "secret" not in sentence


def test_a_network_camera_that_does_not_answer_is_a_warning_and_the_run_begins(
    stage: Path, refused: Callable[..., str], taken: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run ends as if nobody had been tracked."""
    track, free = Mock(side_effect=UserError("nobody was tracked")), free_port()
    monkeypatch.setattr("services.commands.live.track_live", track)
    sources = ["7777", f'"http://127.0.0.1:{taken}/2"', f'"rtsp://user:secret@127.0.0.1:{free}/1"']
    warning, *_, last = said_of(stage, refused, sources).splitlines()
    assert warning.startswith(
        f"warning: [cameras.cam03] source: rtsp://127.0.0.1:{free}/1 does not answer: connection refused "
        f"(host 127.0.0.1, port {free}): connect and switch on the camera, or correct the address"
    )
    assert "nobody was tracked" in last
    track.assert_called_once()


def test_a_group_without_a_coordinator_is_not_served(stage: Path, refused: Callable[..., str]) -> None:
    said = said_of(stage, refused, [_GOOD] * 3, "--group", "right", head="")
    assert said == f"--group: {stage}/live.toml does not say where the coordinator is: add endpoint to it"


def test_a_group_that_is_served_alone_has_its_own_sources_tested(
    stage: Path, refused: Callable[..., str]
) -> None:
    said = said_of(stage, refused, ["7777", _GOOD, '"gone.mp4"'], "--group", "left")
    assert said.startswith("[cameras.cam01] source: /dev/video7777 is missing")


def test_the_port_of_the_page_is_tried_first(stage: Path, refused: Callable[..., str], taken: int) -> None:
    said = said_of(stage, refused, ["7777", _GOOD, '"gone.mp4"'], "--view", "--port", taken)
    assert said == f"--port {taken}: address already in use: choose another"
