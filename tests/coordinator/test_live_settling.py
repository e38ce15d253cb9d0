"""Live frames are settled between the newest ones, which they do not disturb."""

from itertools import pairwise

import numpy as np
from floor import Floor

from proto.messages import LimbTask
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

N, FPS = 14, 10.0
QUICK = SearchSettings(
    search_limbs="always", arm_grid=(1, 1, 1, 3), leg_grid=(1, 1, 1, 3), contour_steps=2, max_passes=1
)


class Watched(Floor):
    """A floor without workers that remembers all tasks."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.tasks = list[LimbTask]()
        submit = self.dispatcher.submit
        self.dispatcher.submit = lambda tasks: (self.tasks.extend(tasks), submit(tasks))[1]  # type: ignore[method-assign]


def test_frames_are_settled_in_order_and_no_two_tasks_are_taken_for_each_other() -> None:
    actor, rig = Actor(height=1.75), Rig.of(studio_cameras(4))
    body = build_body(actor)
    model, floor = Model(body, rig, CpuBackend(body, rig)), Watched()
    limbs = RemoteLimbs(model, "walk", "0" * 32, actor.content_hash, floor.dispatcher, lambda _: None)
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
        first[-1].distrusted = ["left_arm"] if number in (4, 7) else []
        settling.note(frames[-1], first[-1])
        for _ in range(4):
            settling.work()
            assert (limbs.frame, limbs.sweep) == (number, 0)
    while settling.work():
        pass
    assert {number for number, _, _ in published} < set(range(N))
    settling.conclude()
    assert [number for number, _, _ in published] == list(range(N))
    assert [frame for _, frame, _ in published] == frames
    again = [
        number for (number, _, solution), one in zip(published, first, strict=True) if solution is not one
    ]
    assert {4, 7} <= set(again)
    assert all(later - earlier == 1 for earlier, later in pairwise(again))
    keys = [(task.frame, task.pass_index, task.limb) for task in floor.tasks]
    assert len(keys) == len(set(keys))
    assert (
        len({task.pass_index for task in floor.tasks if task.frame == 6}) == 4
    )  # two ways back, both others
