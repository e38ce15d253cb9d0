"""Solves limb tasks, without a socket."""

import time
from collections import OrderedDict
from dataclasses import replace

import numpy as np

from proto.messages import LONGEST_REASON, LimbRefusal, LimbResult, LimbTask
from services.blob_store import BlobStore, keep_latest
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import CLASS_BITS
from services.mocap.energy.engine import Engine
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.limb import solve_limb
from services.mocap.search.model import Model, model_of
from services.mocap.search.settings import SearchSettings

_KEPT_BESIDE = 3
"""Number of pairs of actor and rig kept in addition to one per take, for takes that just ended or were just
fitted."""
_FARTHEST = 10_000.0
"""Poses with larger numbers, in metres or radians, are refused."""


class LimbSolver:
    """Solves limb tasks; keeps the content that they name and what was built from it, and nothing else."""

    def __init__(self, engine: Engine, takes: int = 1) -> None:
        """takes: how many takes are served at the same time."""
        self._engine, self._most = engine, takes + _KEPT_BESIDE
        self.blobs = BlobStore(self._most)
        self._models: OrderedDict[tuple[str, str], Model] = OrderedDict()

    def solve(self, task: LimbTask) -> LimbResult | LimbRefusal:
        """Solve a task whose content is complete; refuses a task that makes no sense."""
        began = time.perf_counter()
        try:
            model = self._model(task)
            settings = SearchSettings.model_validate(task.search)
            _check(task, model.rig)
            region = Region(task.origin_px, task.window.shape[2], task.window.shape[1])
            unsure = task.unsure if len(task.unsure) else None
            window = Picture.of_region(model.rig, region, task.window, unsure)
            window = replace(window, classes=task.classes if len(task.classes) else None)
            found = solve_limb(model, task.limb, window, task.pose, settings, (task.shard, task.shards))
        except ValueError as error:
            return LimbRefusal(**task.task_key, reason=str(error)[:LONGEST_REASON])
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
            rig = self.blobs.rig(task)
            model = model_of(self.blobs.actor(task), rig, self._engine)
            for forgotten in keep_latest(self._models, key, model, self._most):
                forgotten.close()
        self._models.move_to_end(key)
        return self._models[key]


def _check(task: LimbTask, rig: Rig) -> None:
    """Raise ValueError unless a task's numbers are consistent with each other and the rig."""
    if task.shard >= task.shards:
        raise ValueError(f"shard: expected less than {task.shards}, got {task.shard}")
    if task.origin_px.shape != (rig.n_cameras, 2):
        raise ValueError(f"origin_px: expected {rig.n_cameras} cameras, got {len(task.origin_px)}")
    largest_px = max(rig.shape_px)
    if not all(1 <= size <= largest_px for size in task.window.shape[1:]):
        raise ValueError(f"window: expected sides of 1 to {largest_px} pixels, got {task.window.shape[1:]}")
    if np.any((task.origin_px < -largest_px) | (task.origin_px > largest_px)):
        raise ValueError(f"origin_px: a window is farther than {largest_px} pixels from its picture")
    if len(task.classes) not in (0, CLASS_BITS):
        raise ValueError(f"classes: expected {CLASS_BITS} bits or none, got {len(task.classes)}")
    if np.abs(task.pose).max() > _FARTHEST:
        raise ValueError(f"pose: expected metres and radians up to {_FARTHEST:.0f}")
