"""Measurements beside the paper's own numbers: what `scripts/bench` prints."""

import json
import os
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, SIDES
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SEGMENTS, HEAD, LIMBS, Stage
from services.mocap.search.solve import Model, stage_window
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Floats

app = typer.Typer(no_args_is_help=True, add_completion=False, help="Measure, beside the paper's numbers.")

_REPEATS = 7
_REPEAT_S = 0.3


@dataclass(frozen=True)
class Row:
    """One measured figure."""

    name: str
    backend: str
    value: float
    unit: str
    paper: float | None
    """The paper's figure on its GeForce3, table 1."""


@app.callback()
def _commands() -> None:
    """Keep `table1` a subcommand, since others come beside it."""


@app.command()
def table1(
    json_path: Annotated[Path | None, typer.Option("--json", help="Write the figures here as well.")] = None,
) -> None:
    """Energy evaluations per second by window, plain and pre-rendered (the paper's table 1)."""
    rows = _table1()
    table = Table("window", "backend", "evaluations/s", "paper")
    for row in rows:
        table.add_row(row.name, row.backend, f"{row.value:.0f}", f"{row.paper}")
    Console().print(table)
    if json_path is not None:
        machine = {
            "cores": os.cpu_count(),
            "machine": platform.machine(),
            "python": platform.python_version(),
        }
        json_path.write_text(
            json.dumps({"machine": machine, "rows": [asdict(row) for row in rows]}, indent=2)
        )


def _table1() -> list[Row]:
    """One thread, 8 cameras of 320x240, the full mesh, one pose at a time as in a descent."""
    rig, body = Rig.of(studio_cameras()), build_body(Actor())
    backend = CpuBackend(body, rig)
    model, pose = Model(body, rig, backend), _standing(body.pelvis_height_m)
    whole = Picture.whole(rig, backend.coverage(pose[None], ALL_SEGMENTS, Region.whole(rig))[0])
    everything = Stage(tuple(range(N_DOF)), ALL_SEGMENTS, 0)
    rows = []
    for name, stage, picture, papers in (
        ("320x240 (full)", everything, whole, (95.9, 95.5)),
        ("160x120 (half-res)", everything, whole.halved(), (131.1, 131.2)),
        ("128x128 (arm)", LIMBS["left_arm"].main, None, (133.7, 433.1)),
        ("64x64 (head)", HEAD, None, (144.9, 855.4)),
        ("64x64 (hand)", LIMBS["left_arm"].extremity, None, (None, None)),
    ):
        window = picture or stage_window(model, stage, whole, pose)
        rows.append(_rate(f"{name} XOR", model, pose, stage.dofs, ALL_SEGMENTS, window, papers[0]))
        if stage.others:
            others = backend.coverage(pose[None], stage.others, window.region)[0]
            window = window.ignoring(others)
        rows.append(_rate(f"{name} XORPR", model, pose, stage.dofs, stage.segments, window, papers[1]))
    return rows


def _rate(
    name: str,
    model: Model,
    pose: Floats,
    dofs: tuple[int, ...],
    segments: tuple[int, ...],
    picture: Picture,
    paper: float | None,
) -> Row:
    """The median rate over poses that differ a little from each other."""
    energy = model.backend.energy(Problem(pose, dofs, segments, picture))
    rng = np.random.default_rng(0)
    values = pose[list(dofs)] + rng.normal(0.0, 0.02, (64, len(dofs)))
    rate = statistics.median(_timed(lambda k: energy(values[k % 64, None])) for _ in range(_REPEATS))
    return Row(name, model.backend.name, round(rate, 1), "evaluations/s", paper)


def _timed(call: Callable[[int], object]) -> float:
    """Calls per second."""
    count, began = 0, time.perf_counter()
    while (elapsed_s := time.perf_counter() - began) < _REPEAT_S:
        call(count)
        count += 1
    return count / elapsed_s


def _standing(pelvis_height_m: float) -> Floats:
    """An upright pose (35,) with the arms hanging a little off the body."""
    pose = np.zeros(N_DOF)
    pose[DOF_INDEX["root_z"]] = pelvis_height_m
    for side in SIDES:
        pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = -1.2
        pose[DOF_INDEX[f"{side}_elbow_flexion"]] = 0.3
    return pose


if __name__ == "__main__":
    app()
