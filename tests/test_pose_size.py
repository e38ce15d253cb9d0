"""Poses on the wire: proto takes any number of parameters, the services only those of the skeleton."""

import numpy as np
import pytest

from proto.framing import MalformedMessage, decode, encode
from proto.messages import Beat, Recording
from services.mocap.body.kinematics import N_DOF
from services.pose_size import with_whole_poses


def recording(size: int) -> Recording:
    return Recording(
        take="walk", run="", plan="", shards=1, end_frame=2, retries=0, worker_backends={}, memory={},
        poses=np.zeros((2, size)), actor=np.zeros(0, np.uint8),
    )  # fmt: skip


def test_poses_of_the_skeleton_pass() -> None:
    for message in (recording(N_DOF), Beat()):
        assert with_whole_poses(message) is message


@pytest.mark.parametrize("size", [0, N_DOF - 1, N_DOF + 3])
def test_poses_of_another_skeleton_are_malformed(size: int) -> None:
    arrived = decode([bytes(frame) for frame in encode(recording(size))])
    with pytest.raises(MalformedMessage, match=f"^recording.poses: size {size} where D is {N_DOF}$"):
        with_whole_poses(arrived)
