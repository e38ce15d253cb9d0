"""A segmentation that is not ours, and sends colour classes as a segmentation network finds them."""

import shutil
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import zmq
from busy import ONE_WAY

from proto.messages import Credit, Silhouettes, TakeEnd
from proto.sockets import connect, make_socket, receive, send, wait
from proto.streams import stream_endpoint
from services.mocap.body.actor import build_body
from services.mocap.body.colours import QUARTERS
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import pack, pack_classes, unpack_classes
from services.mocap.energy.colours import ColourPainter
from services.mocap.energy.picture import Region
from services.mocap.take.actor_file import read_actor, take_actor, write_actor
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR
from services.mocap.take.tables import read_poses_csv
from services.mocap.types import Floats
from services.runs.launcher import Launcher, free_endpoint

pytestmark = pytest.mark.timeout(280)
Sent = Callable[[int], Silhouettes]
_FRAMES = 5
_NETWORK = {"head": 3, "left_hand": 2, "right_hand": 2}
"""The classes of a network that knows hands and heads; all else is 1."""


@pytest.fixture
def coloured_take(exact_take: Path, tmp_path: Path) -> Path:
    """The exact take, whose actor.toml says what class each segment shows."""
    take = tmp_path / "coloured"
    shutil.copytree(exact_take, take)
    actor = read_actor(take / ACTOR)
    colours = {name: (_NETWORK.get(name, 1),) * QUARTERS for name in SEGMENT_NAMES}
    write_actor(take / ACTOR, actor.model_copy(update={"colours": colours}), "a network")
    return take


def _network(folder: Path) -> Sent:
    """By frame the message of a network that is never wrong."""
    take = open_take(folder)
    actor, rig = take_actor(take), Rig.of(take.cameras)
    assert actor is not None
    painter = ColourPainter(build_body(actor), rig)
    poses = read_poses_csv(folder / "reference" / "poses.csv").poses

    @cache
    def sent(frame: int) -> Silhouettes:
        paths = [folder / "silhouettes" / camera.name / f"{frame:06d}.png" for camera in take.cameras]
        masks = np.array([cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 0 for path in paths])
        classes = painter.painted(poses[frame], Region.whole(rig))
        return Silhouettes(
            take=take.settings.name,
            run="0" * 32,
            frame=frame,
            cameras=[*range(len(take.cameras))],
            planes=pack(masks),
            classes=pack_classes(np.where(masks, classes, 0).astype(np.uint8)),
        )

    return sent


def _send_all(endpoint: str, sent: Sent, launcher: Launcher) -> None:
    """Follow the credit until the take is over."""
    with zmq.Context() as context:
        poses, silhouettes = make_socket(context, zmq.SUB), make_socket(context, zmq.PUSH)
        connect(poses, stream_endpoint(endpoint, "poses"))
        connect(silhouettes, stream_endpoint(endpoint, "silhouettes"))
        is_over = False
        while not is_over:
            launcher.watch()
            wait([poses], 0.2)
            match receive(poses):
                case Credit(run=run, next_frame=first, end_frame=end):
                    for frame in range(first, end):
                        send(silhouettes, sent(frame).model_copy(update={"run": run}))
                case TakeEnd():
                    is_over = True
        poses.close()
        silhouettes.close()


def _tracked(take: Path, sent: Sent, out: Path) -> Floats:
    """The poses (F, D) that services find in what is sent."""
    endpoint, named = free_endpoint(), ("--take", str(take))
    out.mkdir()
    with Launcher(out) as launcher:
        options = ("--connect", endpoint, "--out", str(out / "result"), "--no-overlay", "--no-report")
        launcher.start("recorder", *named, *options)
        expected = ("--frames", f"0:{_FRAMES}", "--recorders", "1", "--backend", "cpu")
        launcher.start("coordinator", *named, "--bind", endpoint, *expected, *ONE_WAY)
        launcher.start("limb_worker", "--connect", endpoint, "--backend", "cpu")
        _send_all(endpoint, sent, launcher)
        while not launcher.has_ended("recorder"):
            launcher.watch()
            time.sleep(0.1)
    return read_poses_csv(out / "result" / "poses.csv").poses


def test_classes_of_a_network_count(coloured_take: Path, tmp_path: Path) -> None:
    """With the right classes poses are right; those of another actor lead them away."""
    of_network = _network(coloured_take)

    def of_another(frame: int) -> Silhouettes:
        sent = of_network(frame)
        classes = unpack_classes(sent.classes, len(sent.cameras))
        swapped = np.array([0, 2, 1, 3], np.uint8)[classes]
        return sent.model_copy(update={"classes": pack_classes(swapped)})

    offsets_m = build_body(read_actor(coloured_take / ACTOR)).offsets_m
    true, right, wrong = (
        joint_positions(poses[:_FRAMES], offsets_m)
        for poses in (
            read_poses_csv(coloured_take / "reference" / "poses.csv").poses,
            _tracked(coloured_take, of_network, tmp_path / "right"),
            _tracked(coloured_take, of_another, tmp_path / "wrong"),
        )
    )
    right_m, wrong_m = (np.linalg.norm(found - true, axis=-1) for found in (right, wrong))
    assert right_m.mean() < 0.005
    assert wrong_m.max() > 2 * right_m.max()
