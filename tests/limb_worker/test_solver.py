"""Limb tasks are solved just as in the coordinator itself; what makes no sense is refused, never raised."""

import hashlib
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from proto.framing import decode, encode
from proto.messages import Blob, BlobRequest, LimbRefusal, LimbResult, LimbTask
from services.blob_store import UnusableBlobError
from services.limb_worker.solver import LimbSolver
from services.limb_worker.worker import Worker
from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, LOWER, UPPER
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.engine import Engine, open_engine
from services.mocap.energy.picture import Picture, Region
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.chains import ALL_SURFACES, LIMBS
from services.mocap.search.limb import solve_limb
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import stage_window
from services.mocap.take.marks import LimbName
from services.mocap.types import Floats

CPU = open_engine(EngineSettings(backend="cpu"))
_SIZE_PX = 96
_SETTINGS = SearchSettings(arm_grid=(3, 3, 1, 3), leg_grid=(3, 3, 1, 3), descent_rounds=1)


def _camera(angle_rad: float) -> Floats:
    """P (3, 4) of a camera 4 m from the middle, one metre up, that looks at it."""
    ahead = -np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    R = np.array([right, [0.0, 0.0, -1.0], ahead])
    centre_world_m = np.array([4 * np.cos(angle_rad), 4 * np.sin(angle_rad), 1.0])
    K = np.array([[140.0, 0, _SIZE_PX / 2], [0, 140.0, _SIZE_PX / 2], [0, 0, 1]])
    P_px_world: Floats = K @ np.column_stack([R, -R @ centre_world_m])
    return P_px_world


@dataclass(frozen=True)
class Stage:
    """A body before two cameras, and one frame of it."""

    actor: Actor
    rig: Rig
    body: Body
    model: Model
    picture: Picture
    pose: Floats

    def task(self, limb: LimbName = "left_arm", **changed: Any) -> LimbTask:
        window = stage_window(self.model, LIMBS[limb].main, self.picture, self.pose)
        fields: dict[str, Any] = {
            "take": "walk", "run": "0" * 32, "frame": 5, "pass_index": 2, "limb": limb,
            "shard": 0, "shards": 1,
            "actor": self.actor.content_hash, "rig": self.rig.content_hash,
            "search": _SETTINGS.model_dump(mode="json"),
            "pose": self.pose, "origin_px": window.region.origin_px, "window": window.silhouettes,
        }  # fmt: skip
        sent = LimbTask(**{**fields, **changed})
        received = decode([bytes(frame) for frame in encode(sent)])
        assert isinstance(received, LimbTask)
        return received

    def blobs(self) -> tuple[Blob, Blob]:
        return blob("actor", self.actor.to_toml()), blob("rig", self.rig.to_json())

    def solver(self) -> LimbSolver:
        solver = LimbSolver(CPU)
        for content in self.blobs():
            solver.blobs.add(content)
        return solver


def blob(kind: Literal["actor", "rig"], text: str) -> Blob:
    content = np.frombuffer(text.encode(), np.uint8)
    return Blob(hash=hashlib.sha256(text.encode()).hexdigest(), kind=kind, content=content)


@pytest.fixture(scope="module")
def stage() -> Stage:
    actor = Actor(height=1.75)
    rig = Rig(np.array([_camera(0.3), _camera(1.9)]), np.full((2, 2), _SIZE_PX, np.int32))
    body = build_body(actor)
    model = Model(body, rig, CpuBackend(body, rig))
    true_pose = np.zeros(N_DOF)
    true_pose[DOF_INDEX["root_z"]] = body.pelvis_height_m
    for name, angle_rad in (("shoulder_elevation", -0.9), ("elbow_flexion", 0.5), ("hip_flexion", 0.2)):
        true_pose[[DOF_INDEX[f"left_{name}"], DOF_INDEX[f"right_{name}"]]] = angle_rad
    silhouettes = model.backend.coverage(true_pose[None], ALL_SURFACES, Region.whole(rig))[0]
    pose = true_pose.copy()
    pose[DOF_INDEX["left_shoulder_elevation"]] += 0.15
    pose[DOF_INDEX["right_hip_flexion"]] -= 0.15
    return Stage(actor, rig, body, model, Picture.whole(rig, silhouettes), pose)


@pytest.fixture(scope="module")
def ready(stage: Stage) -> LimbSolver:
    """A solver that has all content; nothing that it does changes what it answers."""
    return stage.solver()


def solved(solver: LimbSolver, task: LimbTask) -> LimbResult:
    result = solver.solve(task)
    assert isinstance(result, LimbResult), result
    return result


def test_unsure_pixels_of_a_task_count_as_in_the_coordinator(stage: Stage, ready: LimbSolver) -> None:
    planes = stage.picture.silhouettes
    unsure = np.zeros_like(planes)
    unsure[:, : planes.shape[1] // 2, ::3] = 0b11
    doubtful = replace(stage, picture=Picture.whole(stage.rig, planes, unsure))
    window = stage_window(stage.model, LIMBS["left_arm"].main, doubtful.picture, stage.pose)
    assert window.unsure is not None
    result = solved(ready, doubtful.task(unsure=window.unsure))
    here = solve_limb(stage.model, "left_arm", window, stage.pose, _SETTINGS)
    np.testing.assert_array_equal(result.values, here.values)
    assert result.energy_px == here.energy_px
    refused = ready.solve(doubtful.task(unsure=np.concatenate([window.unsure] * 2)))
    assert isinstance(refused, LimbRefusal)
    assert refused.reason.startswith("unsure: expected shape")


def refused(solver: LimbSolver, task: LimbTask) -> str:
    answer = solver.solve(task)
    assert isinstance(answer, LimbRefusal)
    same = {"take", "frame", "pass_index", "limb", "shard", "shards"}
    assert answer.model_dump(include=same) == task.model_dump(include=same)
    return answer.reason


@pytest.mark.parametrize("limb", ["left_arm", "right_leg"])
@pytest.mark.parametrize(
    "changed",
    [{}, {"detail_px": 0.0}, {"detail_px": 3.0}, {"camera_weights": (1.0, 0.5)}],
    ids=str,
)
def test_equals_solving_it_directly(
    stage: Stage, ready: LimbSolver, limb: LimbName, changed: dict[str, Any]
) -> None:
    """Everything that the energy depends on travels with the task."""
    search = _SETTINGS.model_copy(update=changed)
    task = stage.task(limb, search=search.model_dump(mode="json"))
    window = stage_window(stage.model, LIMBS[limb].main, stage.picture, stage.pose)
    direct = solve_limb(stage.model, limb, window, stage.pose, search)
    result = solved(ready, task)
    assert result.values.tobytes() == direct.values.tobytes()
    assert (result.energy_px, result.evaluations) == (direct.energy_px, direct.evaluations)
    same = {"take", "frame", "pass_index", "limb", "shard", "shards"}
    assert result.model_dump(include=same) == task.model_dump(include=same)
    dofs = list(LIMBS[limb].dofs)
    assert np.all((result.values >= LOWER[dofs]) & (result.values <= UPPER[dofs]))


def test_shards_equal_solving_them_directly_and_share_the_grid(stage: Stage, ready: LimbSolver) -> None:
    window = stage_window(stage.model, LIMBS["left_arm"].main, stage.picture, stage.pose)
    for shard in range(3):
        direct = solve_limb(stage.model, "left_arm", window, stage.pose, _SETTINGS, (shard, 3))
        result = solved(ready, stage.task(shard=shard, shards=3))
        assert result.values.tobytes() == direct.values.tobytes()
        assert result.energy_px == direct.energy_px


def test_the_same_task_gives_the_same_bytes_again_and_in_a_fresh_worker(stage: Stage) -> None:
    one, other = stage.solver(), stage.solver()
    task, between = stage.task("left_arm"), stage.task("right_leg")
    results = [solved(one, task)]
    solved(other, between)
    results += [solved(one, task), solved(other, task)]
    wire = {tuple(map(bytes, encode(result.model_copy(update={"seconds": 0.0})))) for result in results}
    assert len(wire) == 1


def test_solving_changes_nothing_in_the_task(stage: Stage, ready: LimbSolver) -> None:
    task = stage.task()
    before = [bytes(frame) for frame in encode(task)]
    solved(ready, task)
    assert [bytes(frame) for frame in encode(task)] == before


def test_missing_content_is_named_until_it_is_stored(stage: Stage) -> None:
    solver, task = LimbSolver(CPU), stage.task()
    actor, rig = stage.blobs()
    assert solver.blobs.missing(task) == [actor.hash, rig.hash]
    solver.blobs.add(rig)
    assert solver.blobs.missing(task) == [actor.hash]
    solver.blobs.add(actor)
    assert solver.blobs.missing(task) == []
    solved(solver, task)


_NESTED = "x = " + "[" * 5000 + "]" * 5000


@pytest.mark.parametrize(
    "bad",
    [
        blob("actor", "height = 'tall'"),
        blob("actor", "height = nan"),
        blob("actor", "height = 1.7\nage = 40"),
        blob("actor", "[bone_lengths]\nwing = 0.4"),
        blob("actor", "not toml"),
        blob("actor", _NESTED),
        blob("rig", ""),
        blob("rig", "[]"),
        blob("rig", "[" * 100_000),
        blob("rig", '{"P_px_world": [], "sizes_px": []}'),
        blob("rig", '{"P_px_world": [[[1,0,0,0],[0,1,0,0],[0,0,1,NaN]]], "sizes_px": [[8,8]]}'),
        blob("rig", '{"P_px_world": [[[1,0,0,0],[0,1,0,0],[0,0,1,0]]], "sizes_px": [[8,0]]}'),
        Blob(hash=hashlib.sha256(b"\xff").hexdigest(), kind="rig", content=np.array([255], np.uint8)),
    ],
)
def test_content_that_makes_no_sense_is_not_stored(stage: Stage, bad: Blob) -> None:
    solver = LimbSolver(CPU)
    with pytest.raises(UnusableBlobError, match=f"^{bad.kind} {bad.hash[:8]}: "):
        solver.blobs.add(bad)
    assert bad.hash in solver.blobs.missing(stage.task(actor=bad.hash, rig=bad.hash))


def test_damaged_content_is_not_stored(stage: Stage) -> None:
    solver = LimbSolver(CPU)
    for good in stage.blobs():
        content = good.content.copy()
        content[-2] ^= 1
        with pytest.raises(UnusableBlobError, match="damaged"):
            solver.blobs.add(good.model_copy(update={"content": content}))
    assert len(solver.blobs.missing(stage.task())) == 2


def test_content_of_the_other_kind_is_not_taken(stage: Stage) -> None:
    actor, rig = stage.blobs()
    solver = LimbSolver(CPU)
    for swapped in (actor.model_copy(update={"kind": "rig"}), rig.model_copy(update={"kind": "actor"})):
        with pytest.raises(UnusableBlobError):
            solver.blobs.add(swapped)


def test_content_that_makes_no_sense_is_not_asked_for_again_at_once(stage: Stage) -> None:
    """Its sender would send the same again, as fast as the network allows."""
    sent = list[BlobRequest]()
    link: Any = SimpleNamespace(send=sent.append)
    worker, bad = Worker([link], CPU), blob("actor", "height = 'tall'")
    worker._act(0, stage.task(actor=bad.hash))
    assert bad.hash in {request.hash for request in sent}
    n_sent = len(sent)
    worker._act(0, bad)
    assert len(sent) == n_sent


def test_old_content_is_forgotten_and_asked_for_again(stage: Stage) -> None:
    solver, task = stage.solver(), stage.task()
    actor, _ = stage.blobs()
    for n in range(3):
        solver.blobs.add(blob("actor", Actor(height=1.6 + 0.01 * n).to_toml()))
    assert solver.blobs.missing(task) == []
    solver.blobs.add(actor)
    for n in range(4):
        solver.blobs.add(blob("actor", Actor(height=1.7 + 0.01 * n).to_toml()))
    assert solver.blobs.missing(task) == [actor.hash]
    solver.blobs.add(actor)
    solved(solver, task)


def test_results_say_which_backend_found_them(stage: Stage, ready: LimbSolver) -> None:
    assert solved(ready, stage.task()).backend == "cpu"


def test_a_forgotten_models_backend_is_closed(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    closed: list[str] = []

    class Watched(CpuBackend):
        def close(self) -> None:
            closed.append(made[len(closed)])

    def watched(self: Engine, body: Body, rig: Rig) -> Watched:  # noqa: ARG001  (the signature of the method)
        made.append(f"{body.height_m:.2f} m")
        return Watched(body, rig)

    monkeypatch.setattr(Engine, "backend", watched)
    quick = {"arm_grid": [1, 1, 1, 1], "descent_rounds": 1, "detail_px": 0.0}
    solver = stage.solver()
    for n in range(6):
        other = blob("actor", Actor(height=1.7 + 0.01 * n).to_toml())
        solver.blobs.add(other)
        solved(solver, stage.task(actor=other.hash, search=quick))
    assert made == [f"{1.7 + 0.01 * n:.2f} m" for n in range(6)]
    assert closed == made[:2]


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"window": np.zeros((2, 16, 16), np.uint8)}, "expected shape (1, 16, 16), got (2, 16, 16)"),
        ({"window": np.zeros((0, 16, 16), np.uint8)}, "expected shape (1, 16, 16), got (0, 16, 16)"),
        ({"window": np.zeros((1, 0, 16), np.uint8)}, "window: expected sides of 1 to 96 pixels"),
        ({"window": np.zeros((1, 16, 97), np.uint8)}, "window: expected sides of 1 to 96 pixels"),
        ({"origin_px": np.zeros((1, 2), np.int32)}, "origin_px: expected 2 cameras, got 1"),
        ({"origin_px": np.zeros((8, 2), np.int32)}, "origin_px: expected 2 cameras, got 8"),
        ({"origin_px": np.full((2, 2), -(2**31), np.int32)}, "origin_px: a window is farther than 96"),
        ({"origin_px": np.full((2, 2), 2**31 - 1, np.int32)}, "origin_px: a window is farther than 96"),
        ({"pose": np.full(N_DOF, 1e300)}, "pose: expected metres and radians up to 10000"),
        ({"shard": 2, "shards": 2}, "shard: expected less than 2, got 2"),
        ({"search": {"arms": 3}}, "arms"),
        ({"search": {"max_passes": 0}}, "max_passes"),
        ({"search": {"arm_grid": [5, 5]}}, "arm_grid"),
        ({"search": {"arm_grid": [0, 5, 5, 5]}}, "arm_grid"),
        ({"search": {"arm_grid": [10_000] * 4}}, "arm_grid"),
        ({"search": {"grid_step_rad": "wide"}}, "grid_step_rad"),
        ({"search": {"detail_px": -1.0}}, "detail_px"),
        ({"search": {"camera_weights": [1.0]}}, "camera_weights: expected 2, one per camera, or none"),
    ],
)  # fmt: skip
def test_tasks_that_make_no_sense_are_refused(
    stage: Stage, ready: LimbSolver, changed: dict[str, Any], reason: str
) -> None:
    assert reason in refused(ready, stage.task(**changed))


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_whatever_a_task_holds_it_gets_an_answer(
    stage: Stage, ready: LimbSolver, data: st.DataObject
) -> None:
    size = st.integers(0, 40)
    shape = (data.draw(st.integers(0, 2)), data.draw(size), data.draw(size))
    origins = data.draw(st.lists(st.integers(-120, 120), min_size=4, max_size=4))
    pose = stage.pose.copy()
    pose[data.draw(st.integers(0, N_DOF - 1))] = data.draw(st.floats(-2e4, 2e4))
    task = stage.task(
        data.draw(st.sampled_from(list(LIMBS))),
        window=np.full(shape, data.draw(st.integers(0, 255)), np.uint8),
        origin_px=np.array(origins, np.int32).reshape(2, 2),
        pose=pose,
        search={"arm_grid": [1, 1, 1, 1], "leg_grid": [1, 1, 1, 1], "descent_rounds": 1},
    )
    answer = ready.solve(task)
    assert isinstance(answer, LimbResult | LimbRefusal)
    if isinstance(answer, LimbResult):
        dofs = list(LIMBS[task.limb].dofs)
        assert np.all((answer.values >= LOWER[dofs]) & (answer.values <= UPPER[dofs]))
        encode(answer)
