"""What a slow browser is measured with: the line, the take that goes on, what is read of a page."""

import socket
import struct
import threading
import time
from pathlib import Path

import numpy as np

from bench.line import Line, SlowProxy
from bench.looped import looped
from bench.slow_browser import frames_shown
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.folder import open_take
from services.viewer.markup import camera_grid, lines_of
from services.viewer.tiles import Tile

_ANSWER = bytes(range(256)) * 100


def _serve_once(listener: socket.socket) -> None:
    connection, _ = listener.accept()
    with connection:
        assert connection.recv(5) == b"hello"
        connection.sendall(_ANSWER)


def test_a_line_takes_its_time_and_loses_nothing() -> None:
    line = Line(bytes_per_s=50_000, latency_s=0.1)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=_serve_once, args=(listener,), daemon=True).start()
        with SlowProxy(listener.getsockname()[1], line) as slow:
            began_s = time.monotonic()
            with socket.create_connection(("127.0.0.1", slow.port)) as browser:
                browser.sendall(b"hello")
                came = b"".join(iter(lambda: browser.recv(65_536), b""))
    assert came == _ANSWER
    assert time.monotonic() - began_s >= 2 * line.latency_s + len(_ANSWER) / line.bytes_per_s


def _reset_after_answering(listener: socket.socket) -> None:
    connection, _ = listener.accept()
    with connection:
        connection.sendall(_ANSWER)
        assert connection.recv(5) == b"hello"  # it has all
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def test_a_connection_that_breaks_off_ends_and_repeats_nothing() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=_reset_after_answering, args=(listener,), daemon=True).start()
        with (
            SlowProxy(listener.getsockname()[1], Line(1e6, 0.01)) as slow,
            socket.create_connection(("127.0.0.1", slow.port), timeout=20) as browser,
        ):
            came = b""
            while len(came) < len(_ANSWER):
                came += browser.recv(65_536)
            browser.sendall(b"hello")
            assert browser.recv(65_536) == b""
    assert came == _ANSWER


def test_a_server_that_is_not_there_yet_is_tried_again() -> None:
    with socket.socket() as late:
        late.bind(("127.0.0.1", 0))
        with SlowProxy(late.getsockname()[1], Line(1e6, 0.0)) as slow:
            with socket.create_connection(("127.0.0.1", slow.port), timeout=20) as browser:
                assert browser.recv(1) == b""
            late.listen()
            threading.Thread(target=_serve_once, args=(late,), daemon=True).start()
            with socket.create_connection(("127.0.0.1", slow.port), timeout=20) as browser:
                browser.sendall(b"hello")
                assert b"".join(iter(lambda: browser.recv(65_536), b"")) == _ANSWER


def test_a_looped_take_begins_again_after_its_last_frame(tmp_path: Path) -> None:
    write_synthetic_take(tmp_path / "short", n_frames=5, n_cameras=1)
    short = open_take(tmp_path / "short")
    take = looped(short, 12, tmp_path / "long")
    assert take.settings.frames == 15
    with short.video(short.cameras[0]) as once, take.video(take.cameras[0]) as over_and_over:
        pictures, all_pictures = list(once), list(over_and_over)
    assert len(all_pictures) == 15
    for n, picture in enumerate(all_pictures):
        np.testing.assert_array_equal(picture, pictures[n % 5])


def test_the_frames_of_a_page_are_read_as_it_writes_them() -> None:
    grid = camera_grid([Tile(0, b"jpeg", None)], ["cam01"], 7)
    status = lines_of([("take", "walk"), ("frame", "9 of 399, 0.36 s, live")])
    messages = [{"type": "GuiUpdateMessage", "updates": {"content": text}} for text in (status, grid, "")]
    assert list(frames_shown([*messages, {"type": "SetPositionMessage"}])) == [("body", 9), ("pictures", 7)]
