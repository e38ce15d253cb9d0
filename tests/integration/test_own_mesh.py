"""A user's own character fitted and tracked by real processes over real sockets."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from busy import BUSY, SHORT

from characters import bind_pose, write_skinned_glb
from services.mocap.body.actor import MESH_FILE, Actor
from services.mocap.take.actor_file import read_actor
from services.mocap.take.layout import ACTOR, SETTINGS

pytestmark = [pytest.mark.timeout(280), pytest.mark.usefixtures("no_report")]


@pytest.fixture(scope="module")
def character(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Mixamo's bones in an A pose; shorter, and of other proportions, than the actor of the take."""
    path = tmp_path_factory.mktemp("character") / "character.glb"
    other = Actor(height=1.6, bone_lengths={"thigh": 0.36, "upper_arm": 0.25})
    write_skinned_glb(path, other, bind_pose(0.8, 0.1))
    return path


@pytest.fixture(scope="module")
def short_take(known_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fitted to a few frames only, and without an actor."""
    folder = tmp_path_factory.mktemp("short") / "walk"
    shutil.copytree(known_take, folder)
    (folder / ACTOR).unlink()
    settings = (folder / SETTINGS).read_text()
    (folder / SETTINGS).write_text(re.sub(r"^init_frames = \d+", "init_frames = 2", settings, flags=re.M))
    return folder


def test_a_skinned_character_is_fitted_and_tracked(
    short_take: Path, character: Path, xormocap, tmp_path: Path
) -> None:
    fitted = xormocap("fit", short_take, "--mesh", character)
    assert fitted.returncode == 0, fitted.stderr
    actor = read_actor(short_take / ACTOR)
    assert actor.mesh is not None
    assert actor.height == pytest.approx(1.75, abs=0.03)
    out = tmp_path / "out"
    common = ("--frames", "0:3", "--workers", 1, *BUSY, *SHORT)
    done = xormocap("track", short_take, "--out", out, *common)
    assert done.returncode == 0, done.stderr
    report = json.loads((out / "run.json").read_text())
    assert report["accuracy"]["mean_mm"] < 20
    assert report["accuracy"]["lost_limbs"] == []
    assert report["actor"]["mesh"]["sha256"] == actor.mesh.content_hash
    assert sum(report["settings"]["worker_limbs_by_backend"].values()) > 0  # they asked for the mesh
    assert read_actor(out / ACTOR) == actor
    assert (out / MESH_FILE).read_bytes() == (short_take / MESH_FILE).read_bytes()


def test_bad_meshes_end_in_one_sentence(
    short_take: Path, refused: Callable[..., str], tmp_path: Path
) -> None:
    scan = tmp_path / "scan.ply"
    scan.write_text("no mesh at all\n")
    for command in ("fit", "track"):
        said = refused(command, short_take, "--no-check", "--mesh", scan, "--out", tmp_path / "out")
        assert said.splitlines()[-1].startswith(f"{scan}: is damaged or not a mesh")
    assert not (tmp_path / "out").exists()
    said = refused("track", short_take, "--mesh", scan, "--no-fit", "--out", tmp_path / "out")
    assert "leave out --fitted and --no-fit" in said
