"""`scripts/check-results RESULT`: whether its files say in other tools what joints.csv says."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from bench.checks import tools
from bench.checks.blender import bvh_joints, glb_joints, imported
from bench.checks.readers import read_points
from bench.checks.validator import complaints
from services.mocap.errors import UserError
from services.mocap.motion.motion import to_y_up
from services.mocap.result.layout import BVH, C3D, GLB, JOINTS, TRC
from services.mocap.result.result import Result, load_result
from services.mocap.take.tables import from_take_world, read_joints_csv
from services.mocap.types import Floats

_CLOSE_MM = 1.0
Verdict = tuple[str, bool, str]
"""What was checked, whether it is well, and what was found."""


def verdicts(result: Result) -> Iterator[Verdict]:
    """Check the files of a result with the tools that are here; a tool that is missing is no fault."""
    missing = [name for name in (JOINTS, BVH, GLB, TRC, C3D) if not (result.folder / name).exists()]
    if missing:
        raise UserError(f"{result.folder / missing[0]}: is missing: run xormocap export {result.folder}")
    joints_world_m = _joints(result)
    yield from _in_blender(result, joints_world_m)
    yield from _in_validator(result.folder / GLB)
    yield from _in_readers(result, joints_world_m)


def _joints(result: Result) -> Floats:
    """joints.csv (N, 15, 3) in the z-up world."""
    joints_take_m = read_joints_csv(result.folder / JOINTS).joints_take_m
    return from_take_world(joints_take_m, "y" if result.run.get("take", {}).get("up") == "y" else "z")


def _in_blender(result: Result, joints_world_m: Floats) -> Iterator[Verdict]:
    program = tools.blender()
    if program is None:
        yield f"{BVH}, {GLB} in Blender", True, "not checked: install blender, or set XORMOCAP_BLENDER"
        return
    bvh, glb = result.folder / BVH, result.folder / GLB
    places = imported(program, (bvh, glb), len(result.frames), result.fps)
    yield _compared(f"{BVH} in Blender", bvh_joints(places[bvh], "xormocap"), joints_world_m)
    yield _compared(f"{GLB} in Blender", glb_joints(places[glb]), joints_world_m)


def _in_validator(glb: Path) -> Iterator[Verdict]:
    node, validator = tools.node(), tools.gltf_validator()
    what = f"{GLB} in Khronos' validator"
    if node is None or validator is None:
        yield what, True, "not checked: run scripts/check-results --install"
        return
    found = complaints(node, validator, glb)
    yield what, not found, "; ".join(found) or "no error, no warning"


def _in_readers(result: Result, joints_world_m: Floats) -> Iterator[Verdict]:
    python = tools.readers_python()
    if python is None:
        yield f"{TRC} in OpenSim, {C3D} in c3d", True, "not checked: run scripts/check-results --install"
        return
    trc, c3d = read_points(python, result.folder / TRC, result.folder / C3D)
    yield _compared(f"{TRC} in OpenSim", trc.points / 1000, to_y_up(joints_world_m))
    yield _compared(f"{C3D} in c3d", c3d.points / 1000, joints_world_m)


def _compared(what: str, found_m: Floats, expected_m: Floats) -> Verdict:
    if found_m.shape != expected_m.shape:
        return what, False, f"{found_m.shape} places, expected {expected_m.shape}"
    off_mm = 1000 * float(np.linalg.norm(found_m - expected_m, axis=-1).max())
    return what, off_mm < _CLOSE_MM, f"joints at most {off_mm:.3f} mm from {JOINTS}"


def main(
    result: Annotated[Path | None, typer.Argument(help="A results folder.", metavar="RESULT")] = None,
    install: Annotated[
        bool, typer.Option("--install", help="Install the glTF validator, OpenSim and c3d first.")
    ] = False,
) -> None:
    """Check a result's motion files in Blender, Khronos' glTF validator, OpenSim and c3d."""
    console, is_well = Console(highlight=False, soft_wrap=True), True
    try:
        if install:
            tools.install()
        for what, well, finding in verdicts(load_result(result)) if result else ():
            is_well = is_well and well
            console.print(f"{'ok   ' if well else 'WRONG'} {what}: {finding}", markup=False)
    except UserError as error:
        console.print(str(error), markup=False)
        sys.exit(2)
    sys.exit(0 if is_well else 1)


if __name__ == "__main__":
    typer.run(main)
