"""Files that are played like cameras, streams, and what happens when they are gone."""

import http.server
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from patience import until
from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.take.live_settings import LiveCamera
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes
from services.segmentation.live.group import Feed
from services.segmentation.live.sources import (
    ContainerClock,
    FileSource,
    Picture,
    SourceLostError,
    StreamSource,
    check_file,
)

_FPS = 20.0


def _grey(level: int) -> Bytes:
    return np.full((48, 64, 3), level, np.uint8)


@pytest.fixture
def camera(small_cameras: Callable[[int], list[Camera]]) -> Camera:
    return small_cameras(1)[0]


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Forty pictures, each four levels brighter than the one before."""
    path = tmp_path / "cam01.mp4"
    with video_writer(path, 64, 48, _FPS) as writer:
        for n in range(40):
            writer.write(_grey(20 + 4 * n))
    return path


def _number(image: Bytes) -> int:
    return round((float(image.mean()) - 20) / 4)


def test_pictures_that_are_not_read_in_time_give_way_to_newer_ones(video: Path) -> None:
    begin_s, left_out = time.monotonic() + 0.1, list[int]()
    source = FileSource(video, begin_s, threading.Event(), left_out.append)
    numbers = [0, 1]
    for n in numbers:
        picture = source.read()
        assert picture is not None
        assert _number(picture.image) == n
    time.sleep(0.75)  # of twenty a second
    for _ in range(3):
        picture = source.read()
        assert picture is not None
        numbers.append(_number(picture.image))
        assert picture.taken_s == pytest.approx(begin_s + numbers[-1] / _FPS, abs=1e-4)
        assert time.monotonic() >= picture.taken_s
    assert numbers[2] % 5 == 0
    assert numbers[2] >= 15
    assert numbers[3:] == [numbers[2] + 1, numbers[2] + 2]
    assert left_out == [numbers[2] - 2]
    time.sleep(max(begin_s + 40 / _FPS + 0.5 - time.monotonic(), 0))
    assert source.read() is None


def test_a_file_comes_at_its_own_rate(video: Path) -> None:
    begin_s = time.monotonic() + 0.1
    source = FileSource(video, begin_s, threading.Event())
    for n in range(6):
        picture = source.read()
        assert picture is not None
        assert time.monotonic() >= picture.taken_s
        assert picture.taken_s == pytest.approx(begin_s + n / _FPS, abs=1e-4)
        assert _number(picture.image) == n
    source.close()


def test_a_file_that_is_opened_late_is_where_it_would_be(video: Path) -> None:
    source = FileSource(video, time.monotonic() - 1.02, threading.Event())
    picture = source.read()
    assert picture is not None
    assert _number(picture.image) == pytest.approx(21, abs=3)
    source.close()
    over = FileSource(video, time.monotonic() - 60, threading.Event())
    assert over.read() is None
    over.close()


def test_a_file_that_is_taken_away_is_an_unplugged_camera(video: Path, camera: Camera) -> None:
    begin_s, came = time.monotonic(), list[tuple[float, int]]()
    feed = Feed(
        camera,
        lambda stopped: FileSource(video, begin_s, stopped),
        lambda image, taken_s: came.append((taken_s, _number(image))),
    )
    until(lambda: len(came) > 3)
    away = video.rename(video.with_suffix(".away"))
    time.sleep(0.5)
    before = len(came)
    away.rename(video)
    until(lambda: feed.has_ended)
    feed.join()
    assert len(came) > before
    assert feed.problem is None
    for taken_s, number in came:
        assert number == round((taken_s - begin_s) * _FPS)
    gaps = np.diff([number for _, number in came])
    assert gaps.min() >= 1
    assert gaps.max() >= 8


def test_a_camera_that_returns_with_another_size_stays_lost(
    camera: Camera, caplog: pytest.LogCaptureFixture
) -> None:
    """It may come back as it was; the others go on."""
    small, large = (Picture(np.zeros((height, 64, 3), np.uint8), 0.0) for height in (48, 96))
    connections, came = [[small, SourceLostError("unplugged")], [large], [small, None]], list[int]()

    def begin(_: threading.Event) -> Any:
        return SimpleNamespace(read=Mock(side_effect=connections.pop(0)), close=lambda: None)

    feed = Feed(camera, begin, lambda image, _: came.append(len(image)))
    until(lambda: feed.has_ended)
    feed.join()
    assert feed.problem is None
    assert came == [48, 48]
    assert "cam01 is lost; trying to reconnect: cam01: has pictures of 64x96 pixels" in caplog.text


def test_a_picture_of_another_size_is_said(video: Path, camera: Camera, tmp_path: Path) -> None:
    path = tmp_path / "wide.mp4"
    with video_writer(path, 128, 48, _FPS) as writer:
        writer.write(np.zeros((48, 128, 3), np.uint8))
    with pytest.raises(UserError, match=r"of 128x48 pixels, but \[cam01\] was calibrated with 64x48"):
        check_file(LiveCamera(source=str(path)), camera)
    check_file(LiveCamera(source=str(video)), camera)


def test_stamps_of_a_container_take_out_what_the_network_delays() -> None:
    rng, clock = np.random.default_rng(2), ContainerClock()
    taken_s = 5000 + np.arange(400) / 25
    delays_s = 0.02 + rng.exponential(0.03, 400)
    found_s = [clock.taken_s(t - 4990, t + d) for t, d in zip(taken_s, delays_s, strict=True)]
    assert np.abs(np.array(found_s)[50:] - taken_s[50:] - 0.02).max() < 0.012


def test_a_clock_that_steps_back_is_another_one() -> None:
    """As after a correction of the camera's time by a second: the lag is not kept for minutes."""
    clock = ContainerClock()
    before_s, after_s = 5000 + np.arange(50) / 25, 5002 + np.arange(50) / 25
    for taken_s in before_s:
        clock.taken_s(taken_s - 4900, taken_s + 0.02)
    found_s = [clock.taken_s(taken_s - 4901, taken_s + 0.02) for taken_s in after_s]
    assert np.abs(np.array(found_s) - after_s - 0.02).max() < 1e-6


def test_stamps_of_this_machines_clock_are_believed() -> None:
    assert ContainerClock().taken_s(7000.0, 7000.05) == 7000.0


class _Camera(http.server.BaseHTTPRequestHandler):
    """An HTTP camera that sends JPEG pictures one after the other."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        for n in range(30):
            jpeg = cv2.imencode(".jpg", _grey(20 + 4 * n))[1].tobytes()
            head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            try:
                self.wfile.write(head.encode() + jpeg + b"\r\n")
            except OSError:
                return
            time.sleep(0.03)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def address() -> Iterator[str]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Camera) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def test_an_http_camera_is_stamped_by_arrival(address: str, camera: Camera) -> None:
    source = StreamSource(LiveCamera(source=address, delay_s=0.5), camera, 30.0)
    picture = source.read()
    assert picture is not None
    assert picture.image.shape == (48, 64, 3)
    assert time.monotonic() - picture.taken_s == pytest.approx(0.5, abs=0.3)
    with pytest.raises(SourceLostError, match=r"127\.0\.0\.1"):
        while source.read() is not None:
            pass
    source.close()


def test_what_is_not_there_is_lost_and_passwords_are_not_told(camera: Camera) -> None:
    with pytest.raises(SourceLostError) as lost:
        StreamSource(LiveCamera(source="http://me:secret@127.0.0.1:9/"), camera, 30.0)
    assert str(lost.value).startswith("http://127.0.0.1:9/: ")
    with pytest.raises(SourceLostError, match="/dev/video99: "):
        StreamSource(LiveCamera(source=99), camera, 30.0)
