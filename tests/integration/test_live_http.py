"""`xormocap live` on network cameras: JPEG pictures over HTTP, one connection per camera, which never end."""

import http.server
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.settings import EngineSettings
from services.mocap.motion.settings import OutputSettings
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import open_take
from services.mocap.take.live import open_live
from services.mocap.take.tables import read_joints_csv, read_poses_csv
from services.runs.live import LiveJob, live
from services.runs.progress import Progress

pytestmark = pytest.mark.timeout(280)

_PERIOD_S = 1.0
"""Of fifteen a second: so that nothing has to be left out on a machine that is busy with other tests."""
_POSES = 5


class _Cameras(http.server.ThreadingHTTPServer):
    """Answers /NAME with the pictures of a take's camera, all cameras in step, to and fro without an end."""

    daemon_threads = True

    def __init__(self, take_folder: Path) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        take = open_take(take_folder)
        self.jpegs = {
            camera.name: [
                cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
                for picture in take.video(camera)
            ]
            for camera in take.cameras
        }
        self.began_s = time.monotonic()


class _Handler(http.server.BaseHTTPRequestHandler):
    server: _Cameras

    def do_GET(self) -> None:
        jpegs = self.server.jpegs[self.path.strip("/")]
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        number = int((time.monotonic() - self.server.began_s) / _PERIOD_S)
        while True:
            number += 1
            time.sleep(max(self.server.began_s + number * _PERIOD_S - time.monotonic(), 0))
            jpeg = jpegs[_to_and_fro(number, len(jpegs))]
            head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            try:
                self.wfile.write(head.encode() + jpeg + b"\r\n")
            except OSError:
                return

    def log_message(self, *_: object) -> None:
        pass


def _to_and_fro(number: int, n_pictures: int) -> int:
    phase = number % (2 * n_pictures - 2)
    return min(phase, 2 * n_pictures - 2 - phase)


@pytest.fixture
def cameras(synthetic_take: Path) -> Iterator[_Cameras]:
    with _Cameras(synthetic_take) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


@pytest.fixture
def job(synthetic_take: Path, cameras: _Cameras, tmp_path: Path) -> LiveJob:
    folder = tmp_path / "stage"
    shutil.copytree(synthetic_take / "background", folder / "background")
    for name in ("calibration.toml", "actor.toml"):
        shutil.copy(synthetic_take / name, folder)
    poses = read_poses_csv(synthetic_take / "reference" / "poses.csv").poses
    (folder / "live.toml").write_text(
        f'name = "stage"\nfps = {1 / _PERIOD_S}\nup = "z"\ncalibration = "calibration.toml"\n'
        f'background = "background"\nactor = "actor.toml"\ngrace_s = 0.5\n'
        f"facing = {np.degrees(poses[0, DOF_INDEX['root_heading']]):.1f}\n"
        + "".join(
            f'[cameras.{name}]\nsource = "http://127.0.0.1:{cameras.server_port}/{name}"\n'
            for name in cameras.jpegs
        )
    )
    return LiveJob(
        config=folder / "live.toml",
        take=open_live(folder / "live.toml"),
        out=tmp_path / "out",
        workers=1,
        engine=EngineSettings(),
        search=SearchSettings(),
        output=OutputSettings(smooth="none"),
        segmenter="auto",
        page=None,
        record=None,
        keys=None,
    )


def _stopping_at(n_poses: int) -> Callable[[Progress], None]:
    """Asks for a stop as Ctrl-C does, once: streams do not end."""
    asked = threading.Event()

    def show(progress: Progress) -> None:
        if progress.frames_done >= n_poses and not asked.is_set():
            asked.set()
            os.kill(os.getpid(), signal.SIGINT)

    return show


def test_streams_are_tracked_until_a_stop_is_asked_for(job: LiveJob, synthetic_take: Path) -> None:
    report = live(job, show=_stopping_at(_POSES))
    assert report is not None
    poses, truth = (
        read_poses_csv(job.out / "poses.csv"),
        read_joints_csv(synthetic_take / "reference" / "joints.csv"),
    )
    joints = read_joints_csv(job.out / "joints.csv")
    shots, n_pictures = poses.extra["shot"].astype(int), len(truth.frames)
    assert len(shots) >= _POSES
    assert np.all(np.diff(shots) > 0)
    # Which picture was the first one depends on when the cameras were called; from there on shots count them.
    begun_at = [
        truth.joints_take_m[[_to_and_fro(begin + shot, n_pictures) for shot in shots]]
        for begin in range(2 * n_pictures - 2)
    ]
    off_mm = [1000 * np.linalg.norm(joints.joints_take_m - world_m, axis=2).mean() for world_m in begun_at]
    assert min(off_mm) < 20
