"""Live frames are settled between the newest ones, which they do not disturb."""

import numpy as np
import pytest

from proto.messages import LimbTask
from services.coordinator.dispatch import Dispatcher
from services.coordinator.incoming import Frame
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.live_settling import LiveSettling
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.found import FrameSolution
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.tracker import Tracker
from services.mocap.synth.studio import studio_cameras

N, FPS = 24, 10.0
QUICK = SearchSettings(
    search_limbs="always", arm_grid=(1, 1, 1, 3), leg_grid=(1, 1, 1, 3), contour_steps=2, max_passes=1
)


class Watched(Dispatcher):
    """A dispatcher without workers that remembers all tasks."""

    def __init__(self) -> None:
        super().__init__(lambda *_: False, lambda: 0.0)
        self.tasks = list[LimbTask]()

    def submit(self, tasks: list[LimbTask]) -> None:
        """See Dispatcher.submit."""
        self.tasks += tasks
        super().submit(tasks)


@pytest.mark.parametrize("steps_a_frame", [0, 3, 8])
def test_frames_are_settled_in_order_and_no_two_tasks_are_taken_for_each_other(steps_a_frame: int) -> None:
    """Doubts are everywhere, and there is no time for them, little time, or enough."""
    actor, rig = Actor(height=1.75), Rig.of(studio_cameras(4))
    body = build_body(actor)
    model, dispatcher = Model(body, rig, CpuBackend(body, rig)), Watched()
    limbs = RemoteLimbs(model, "walk", "0" * 32, actor.content_hash, dispatcher, lambda _: None)
    pose = clip_to_limits(np.zeros((1, N_DOF)))[0]
    pose[2] = body.pelvis_height_m
    seen = TriPlanes.sure(model.backend.coverage(pose[None], ALL_SURFACES, Region.whole(rig))[0])
    published = list[tuple[int, Frame, FrameSolution]]()
    settling = LiveSettling(model, QUICK, limbs, 0, lambda *settled: published.append(settled))
    tracker, frames, first = Tracker(model, QUICK, limbs, pose[None]), list[Frame](), list[FrameSolution]()
    for number in range(N):
        limbs.frame = number
        frames.append(Frame(seen, number / FPS, number, shutter_s=number / FPS))
        first.append(tracker.solve(seen))
        first[-1].distrusted = ["left_arm"] if number > 2 else []
        settling.note(frames[-1], first[-1], tracker.memory())
        for _ in range(steps_a_frame):
            settling.work()
            assert limbs.frame == number
        assert len(frames) - len(published) <= 13  # those of 1.2 seconds
    settling.conclude()
    assert [number for number, _, _ in published] == list(range(N))
    assert [frame for _, frame, _ in published] == frames
    again = {number for number, _, solution in published if solution is not first[number]}
    assert (len(again) > 0) == (steps_a_frame > 0)
    assert all(published[number][2].seconds == first[number].seconds for number in again)
    keys = [(task.frame, task.pass_index, task.limb) for task in dispatcher.tasks]
    assert len(keys) == len(set(keys))
