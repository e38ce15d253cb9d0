"""Actors with an own mesh: workers and recorders ask for it once they have the actor."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from proto.messages import Blob, LimbTask, TakeInfo
from services.blob_store import UnusableBlobError
from services.limb_worker.solver import LimbSolver
from services.mocap.body.actor import Actor
from services.mocap.body.body_mesh import OwnMesh, generic_mesh
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import open_engine
from services.mocap.energy.settings import EngineSettings
from services.recorder.collection import Collection
from services.recorder.store import Store

MESH = OwnMesh.of(generic_mesh())
ACTOR = Actor(height=1.7, mesh=MESH)


def blob(kind: str, content: bytes) -> Blob:
    name = hashlib.sha256(content).hexdigest()
    return Blob(hash=name, kind=kind, content=np.frombuffer(content, np.uint8))


ACTOR_BLOB, MESH_BLOB = blob("actor", ACTOR.to_toml().encode()), blob("mesh", MESH.content)


@pytest.fixture
def task() -> LimbTask:
    return LimbTask.model_construct(actor=ACTOR.content_hash, rig="0" * 64)


@pytest.mark.parametrize("first", [ACTOR_BLOB, MESH_BLOB], ids=["actor first", "mesh first"])
def test_a_worker_asks_for_the_mesh_that_an_actor_names(task: LimbTask, first: Blob) -> None:
    solver = LimbSolver(open_engine(EngineSettings(backend="cpu")))
    assert solver.blobs.missing(task) == [ACTOR.content_hash, task.rig]
    solver.blobs.add(first)
    wanted = MESH.content_hash if first is ACTOR_BLOB else ACTOR.content_hash
    assert solver.blobs.missing(task) == [wanted, task.rig]
    solver.blobs.add(MESH_BLOB if first is ACTOR_BLOB else ACTOR_BLOB)
    assert solver.blobs.missing(task) == [task.rig]


def test_a_damaged_mesh_is_not_kept(task: LimbTask) -> None:
    solver = LimbSolver(open_engine(EngineSettings(backend="cpu")))
    solver.blobs.add(ACTOR_BLOB)
    with pytest.raises(UnusableBlobError, match="it is not a file of xormocap"):
        solver.blobs.add(blob("mesh", MESH.content[:-100]))
    assert solver.blobs.missing(task)[0] == MESH.content_hash


def test_a_recorder_is_not_done_without_the_mesh(tmp_path: Path) -> None:
    rig = blob("rig", Rig(np.ones((1, 3, 4)), np.array([[4, 4]], np.int32)).to_json().encode())
    collection = Collection(Store(tmp_path))
    info = {"actor": ACTOR.content_hash, "rig": rig.hash, "plan": "0" * 64, "backend": "cpu"}
    info |= {"first_frame": 0, "end_frame": 2, "fps": 25.0, "shards": 1, "threads": 1, "search": {}}
    collection.add(TakeInfo(take="walk", run="0" * 32, backend_reason="asked for", **info))
    for content in (rig, MESH_BLOB, ACTOR_BLOB):  # what nobody has named yet is not kept
        collection.add(content)
    assert collection.missing_blobs() == [MESH.content_hash]
    collection.add(MESH_BLOB)
    assert collection.missing_blobs() == []
    assert collection.actor() == ACTOR
    assert collection.recording("walk").actor.tobytes() == ACTOR.to_toml().encode()
