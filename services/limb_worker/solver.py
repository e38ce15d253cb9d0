"""Limb tasks solved, without a socket."""

import hashlib
import time
from collections import OrderedDict
from typing import TypeVar

import numpy as np

from proto.messages import Blob, LimbRefusal, LimbResult, LimbTask
from services.mocap.body.actor import Actor, build_body, mesh_named_in
from services.mocap.body.body_mesh import OwnMesh
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import Engine
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.limb import solve_limb
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings

_KEPT_BESIDE = 3
"""Pairs of actor and rig that are kept beside one for each take: of takes just over, or fitted just now."""
_FARTHEST = 10_000.0
"""Poses with larger numbers, in metres or radians, are not of this world."""

K = TypeVar("K")
V = TypeVar("V")


class UnusableBlobError(Exception):
    """Content that is not what its message says."""


class LimbSolver:
    """Solves limb tasks; keeps actors, meshes, rigs and what was built from them, and nothing else."""

    def __init__(self, engine: Engine, takes: int = 1) -> None:
        """takes: how many are served at the same time."""
        self._engine, self._most = engine, takes + _KEPT_BESIDE
        self._actors: OrderedDict[str, Actor] = OrderedDict()
        self._rigs: OrderedDict[str, Rig] = OrderedDict()
        self._waiting: OrderedDict[str, tuple[str, str]] = (
            OrderedDict()
        )  # texts of actors without their meshes
        self._meshes: OrderedDict[str, OwnMesh] = OrderedDict()
        self._models: OrderedDict[tuple[str, str], Model] = OrderedDict()

    def missing(self, task: LimbTask) -> list[str]:
        """Hashes of the content that a task names and that is not here."""
        missing_rig = [] if task.rig in self._rigs else [task.rig]
        if task.actor in self._actors:
            return missing_rig
        _, wanted = self._waiting.get(task.actor, ("", task.actor))
        return [wanted, *missing_rig]

    def store(self, blob: Blob) -> None:
        """Keep content; raises UnusableBlobError where it is damaged or not what it is called."""
        content = blob.content.tobytes()
        if hashlib.sha256(content).hexdigest() != blob.hash:
            raise UnusableBlobError(f"{blob.kind} {blob.hash[:8]}: damaged: its hash is another one")
        try:
            if blob.kind == "mesh":
                self._keep(self._meshes, blob.hash, OwnMesh.from_bytes(content))
                self._complete(blob.hash)
            elif blob.kind == "actor":
                self._store_actor(blob.hash, content.decode())
            else:
                self._keep(self._rigs, blob.hash, Rig.from_json(content.decode()))
        except (ValueError, RecursionError) as error:  # TOML's reader recurses into nested arrays
            raise UnusableBlobError(f"{blob.kind} {blob.hash[:8]}: {error}") from None

    def _store_actor(self, name: str, text: str) -> None:
        """Keep an actor, or its text until its mesh is here."""
        mesh = mesh_named_in(text)
        if mesh is None or mesh in self._meshes:
            self._keep(self._actors, name, Actor.from_toml(text, lambda named: self._meshes[named.sha256]))
        else:
            self._keep(self._waiting, name, (text, mesh))

    def _complete(self, mesh: str) -> None:
        """Keep the actors that waited for a mesh."""
        ready = [(name, text) for name, (text, wanted) in self._waiting.items() if wanted == mesh]
        for name, text in ready:
            del self._waiting[name]
            self._store_actor(name, text)

    def solve(self, task: LimbTask) -> LimbResult | LimbRefusal:
        """Solve a task none of whose content is missing; one that makes no sense is refused."""
        began = time.perf_counter()
        try:
            model = self._model(task)
            settings = SearchSettings.from_wire(task.search)
            _check(task, model.rig)
            region = Region(task.origin_px, task.window.shape[2], task.window.shape[1])
            unsure = task.unsure if len(task.unsure) else None
            window = Picture.of_region(model.rig, region, task.window, unsure)
            found = solve_limb(model, task.limb, window, task.pose, settings, (task.shard, task.shards))
        except ValueError as error:
            return LimbRefusal(**task.task_key, reason=str(error)[:1000])
        return LimbResult(
            **task.task_key,
            energy_px=found.energy_px,
            evaluations=found.evaluations,
            seconds=time.perf_counter() - began,
            backend=model.backend.name,
            values=found.values,
        )

    def _model(self, task: LimbTask) -> Model:
        key = (task.actor, task.rig)
        if key not in self._models:
            rig, body = self._rigs[task.rig], build_body(self._actors[task.actor])
            for forgotten in self._keep(self._models, key, Model(body, rig, self._engine.backend(body, rig))):
                forgotten.backend.close()
        self._models.move_to_end(key)
        return self._models[key]

    def _keep(self, kept: OrderedDict[K, V], key: K, value: V) -> list[V]:
        """Add to a table that forgets the oldest; returns those."""
        kept[key] = value
        kept.move_to_end(key)
        return [kept.popitem(last=False)[1] for _ in range(len(kept) - self._most)]


def _check(task: LimbTask, rig: Rig) -> None:
    """Raise ValueError unless the numbers of a task suit each other and the rig."""
    if task.shard >= task.shards:
        raise ValueError(f"shard: expected less than {task.shards}, got {task.shard}")
    if task.origin_px.shape != (rig.n_cameras, 2):
        raise ValueError(f"origin_px: expected {rig.n_cameras} cameras, got {len(task.origin_px)}")
    largest_px = 2 * max(rig.shape_px)  # with the margin that a cost may need
    if not all(1 <= size <= largest_px for size in task.window.shape[1:]):
        raise ValueError(f"window: expected sides of 1 to {largest_px} pixels, got {task.window.shape[1:]}")
    if np.any((task.origin_px < -largest_px) | (task.origin_px > largest_px)):
        raise ValueError(f"origin_px: a window is farther than {largest_px} pixels from its picture")
    if np.abs(task.pose).max() > _FARTHEST:
        raise ValueError(f"pose: expected metres and radians up to {_FARTHEST:.0f}")
