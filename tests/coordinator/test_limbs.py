"""Limbs solved by workers: the frame that comes of it is the one that is found without any."""

from typing import Any

import numpy as np
import pytest
from floor import Floor

from proto.framing import decode, encode
from proto.messages import Blob, LimbTask
from services.coordinator.dispatch import Key, key_of
from services.coordinator.limbs import RemoteLimbs
from services.limb_worker.solver import LimbSolver
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.engine import open_engine
from services.mocap.energy.picture import Picture, Region
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.frame import solve_frame
from services.mocap.search.jobs import LocalLimbs, limb_jobs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Floats

ACTOR, RIG = Actor(height=1.75), Rig.of(studio_cameras(4))
QUICK = SearchSettings(
    search_limbs="always", arm_grid=(3, 3, 1, 3), leg_grid=(3, 1, 1, 3), descent_rounds=1, max_passes=1
)


class Workshop(Floor):
    """A floor whose workers solve what they were given, every message by way of its bytes."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.solver = LimbSolver(open_engine(EngineSettings(backend="cpu")))
        for kind, owner in (("actor", ACTOR), ("rig", RIG)):
            text = owner.to_toml() if isinstance(owner, Actor) else owner.to_json()
            content = np.frombuffer(text.encode(), np.uint8)
            self.solver.blobs.add(Blob(hash=owner.content_hash, kind=kind, content=content))  # type: ignore[arg-type]

    def pump(self, _: float) -> None:
        """Let every worker answer the tasks that it was given."""
        for identity, tasks in self.inbox.items():
            while tasks:
                received = decode([bytes(frame) for frame in encode(tasks.pop(0))])
                assert isinstance(received, LimbTask)
                self.dispatcher.finished(identity, self.solver.solve(received))


@pytest.mark.parametrize(
    "changed",
    [{}, {"detail_px": 0.0}, {"detail_px": 2.0}, {"camera_weights": (1, 0.5, 1, 2)}],
    ids=str,
)
@pytest.mark.parametrize("n_workers", [0, 1, 4])
def test_workers_change_nothing(changed: dict[str, Any], n_workers: int) -> None:
    model, picture, start = _scene()
    search = QUICK.model_copy(update=changed)

    workshop = Workshop()
    workshop.workers(n_workers)
    remote = RemoteLimbs(model, "walk", "0" * 32, ACTOR.content_hash, workshop.dispatcher, workshop.pump)
    apart = solve_frame(model, picture, start[None], search, remote)
    alone = solve_frame(model, picture, start[None], search, LocalLimbs(model))
    assert apart.pose.tobytes() == alone.pose.tobytes()
    assert (apart.energy_px, apart.evaluations) == (alone.energy_px, alone.evaluations)
    assert apart.passes == 1
    assert sum(workshop.dispatcher.helped.values()) == (4 if n_workers else 0)


def test_workers_that_come_or_go_change_nothing_where_limbs_are_shared() -> None:
    model, picture, start = _scene()
    poses = set()
    for n_workers in (0, 1, 3, 8):
        workshop = Workshop()
        workshop.workers(n_workers)
        remote = RemoteLimbs(
            model, "walk", "0" * 32, ACTOR.content_hash, workshop.dispatcher, workshop.pump, shards=2
        )
        poses.add(solve_frame(model, picture, start[None], QUICK, remote).pose.tobytes())
        assert sum(workshop.dispatcher.helped.values()) == (8 if n_workers else 0)
    assert len(poses) == 1


def test_a_late_result_fits_no_later_pass_of_its_frame_and_no_pass_of_another_coordinator() -> None:
    model, picture, start = _scene()
    jobs = limb_jobs(model, picture, start, QUICK)
    keys = list[Key]()
    for _ in range(2):
        floor = Floor()
        workers = floor.workers(8)
        remote = RemoteLimbs(model, "walk", "0" * 32, ACTOR.content_hash, floor.dispatcher, lambda _: None)
        for _ in range(2):
            remote.start(jobs)
        keys += [key_of(task) for worker in workers for task in floor.inbox[worker]]
    assert len(keys) == len(set(keys)) == 16


def _scene() -> tuple[Model, Picture, Floats]:
    """A body that has moved a little, and where it was."""
    body = build_body(ACTOR)
    model = Model(body, RIG, CpuBackend(body, RIG))
    start = np.zeros(N_DOF)
    start[2] = body.pelvis_height_m
    truth = clip_to_limits(start + 0.05 * np.random.default_rng(1).uniform(-1, 1, N_DOF))
    shown = model.backend.coverage(truth[None], ALL_SURFACES, Region.whole(RIG))[0]
    return model, Picture.whole(RIG, shown), start
