"""Exported files in the tools that they are for: Blender, Khronos' validator, OpenSim and the package c3d.

A test is skipped where its tool is missing; `scripts/check-results --install` gets all but Blender.
"""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from bench.checks import tools
from bench.checks.blender import bvh_joints, glb_joints, imported
from bench.checks.readers import read_points
from bench.checks.validator import complaints
from services.mocap.body.humanoid_names import Naming
from services.mocap.export.bvh import write_bvh
from services.mocap.export.formats import Options, write_formats
from services.mocap.export.glb import write_glb
from services.mocap.result.result import Result, load_result
from services.mocap.take.tables import REFERENCE_JOINTS

CLOSE_M = 1e-3


@pytest.fixture(scope="module")
def result(bare_result: Path) -> Result:
    return load_result(bare_result)


def needed(tool: Path | None) -> Path:
    if tool is None:
        pytest.skip("the tool is not installed")
    return tool


def test_blender_puts_the_joints_where_we_do(result: Result, tmp_path: Path) -> None:
    """In BVH files of every naming, unit and rest pose, and in glTF."""
    program, motion = needed(tools.blender()), result.motion
    chosen = list(zip(get_args(Naming), ("m", "cm", "m", "cm"), ("T", "A", "A", "T"), strict=True))
    files = [tmp_path / f"{n}.bvh" for n in range(len(chosen))]
    for file, (naming, unit, rest) in zip(files, chosen, strict=True):
        offsets_m = motion.body.offsets_m
        write_bvh(file, motion.poses, offsets_m, motion.fps, unit=unit, rest=rest, naming=naming)
    write_glb(tmp_path / "motion.glb", motion)
    places = imported(program, [*files, tmp_path / "motion.glb"], len(motion.frames), motion.fps)
    for file, (naming, unit, _) in zip(files, chosen, strict=True):
        joints_m = bvh_joints(places[file], naming) / {"m": 1.0, "cm": 100.0}[unit]
        np.testing.assert_allclose(joints_m, result.joints_world_m, rtol=0, atol=CLOSE_M)
    joints_m = glb_joints(places[tmp_path / "motion.glb"])
    np.testing.assert_allclose(joints_m, result.joints_world_m, rtol=0, atol=CLOSE_M)


def test_khronos_has_no_complaints(result: Result, tmp_path: Path) -> None:
    node, validator = needed(tools.node()), needed(tools.gltf_validator())
    write_glb(tmp_path / "motion.glb", result.motion)
    assert complaints(node, validator, tmp_path / "motion.glb") == []
    content = (tmp_path / "motion.glb").read_bytes()
    (tmp_path / "broken.glb").write_bytes(content.replace(b'"type":"VEC4"', b'"type":"VEC3"', 1))
    assert complaints(node, validator, tmp_path / "broken.glb") != []


def test_a_single_frame_is_a_valid_gltf_too(result: Result, tmp_path: Path) -> None:
    node, validator = needed(tools.node()), needed(tools.gltf_validator())
    motion = result.motion
    alone = replace(motion, frames=motion.frames[:1], times_s=motion.times_s[:1], poses=motion.poses[:1])
    write_glb(tmp_path / "alone.glb", alone)
    assert complaints(node, validator, tmp_path / "alone.glb") == []


def test_opensim_and_c3d_read_the_joints(result: Result, tmp_path: Path) -> None:
    python = needed(tools.readers_python())
    trc, c3d = write_formats(tmp_path, result, ("trc", "c3d"), Options())
    in_opensim, in_c3d = read_points(python, trc, c3d)
    for read, axes in ((in_opensim, [1, 2, 0]), (in_c3d, [0, 1, 2])):
        assert read.labels == REFERENCE_JOINTS
        assert read.unit == "mm"
        assert read.rate_hz == pytest.approx(result.fps)
        expected_m = result.joints_world_m[..., axes]
        np.testing.assert_allclose(read.points / 1000, expected_m, rtol=0, atol=CLOSE_M)
