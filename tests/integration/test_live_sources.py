"""What `xormocap live` says before the work where a source or the page's port cannot be had."""

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from services.mocap.camera.calibration import write_calibration
from services.mocap.camera.camera import Camera
from services.mocap.take.writer import video_writer
from services.runs.launcher import free_port

_GOOD = '"cam.mp4"'


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


def said_of(stage: Path, refused: Callable[..., str], sources: list[str], *options: object) -> str:
    """What the command says of these sources, in one line; cam01 is of the group "left", on another host."""
    groups = ("left", "right", "right")
    (stage / "live.toml").write_text(
        'name = "stage"\nfps = 10.0\nup = "z"\ncalibration = "calibration.toml"\nelsewhere = ["left"]\n'
        'endpoint = "tcp://127.0.0.1:5550"\n'
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
        (
            '"rtsp://user:secret@127.0.0.1:{free}/1"',
            "rtsp://127.0.0.1:{free}/1 does not answer: connection refused (host 127.0.0.1, port {free})",
        ),
        ('"http://127.0.0.1:99999/1"', "expected an address such as rtsp://HOST:PORT/PATH"),
    ],
    ids=["file", "damaged file", "device", "stream", "address"],
)
def test_a_source_that_is_not_there_is_named_with_its_camera(
    stage: Path, refused: Callable[..., str], taken: int, source: str, said: str
) -> None:
    """Of the cameras of this host: cam01, which another one serves, is missing as well."""
    free = free_port()
    sources = ["7777", f'"http://127.0.0.1:{taken}/2"', source.replace("{free}", str(free))]
    sentence = said_of(stage, refused, sources)
    assert sentence.startswith("[cameras.cam03] source: ")
    assert said.replace("{free}", str(free)) in sentence
    assert "\n" not in sentence
    assert "secret" not in sentence


def test_a_group_that_is_served_alone_has_its_own_sources_tested(
    stage: Path, refused: Callable[..., str]
) -> None:
    said = said_of(stage, refused, ["7777", _GOOD, '"gone.mp4"'], "--group", "left")
    assert said.startswith("[cameras.cam01] source: /dev/video7777 is missing")


def test_the_port_of_the_page_is_tried_first(stage: Path, refused: Callable[..., str], taken: int) -> None:
    said = said_of(stage, refused, ["7777", _GOOD, '"gone.mp4"'], "--view", "--port", taken)
    assert said == f"--port {taken}: address already in use: choose another"
