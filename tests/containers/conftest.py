"""The image, a short take, and how it is tracked without containers; skipped where there is no Docker."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from stack import FEW, IMAGE, SLOWLY, Stack, docker

from first_pose import say_first_pose
from known_actor import write_take_of_known_actor


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "containers: needs a Docker engine with compose v2")


@pytest.fixture(scope="session")
def image() -> str:
    """The image of the working tree's services; layers that are built already are taken as they are."""
    for asked in (["docker", "info"], ["docker", "compose", "version"]):
        try:
            answer = subprocess.run(asked, capture_output=True, timeout=30, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            pytest.skip(f"{' '.join(asked)}: {error}")
        if answer.returncode != 0:
            pytest.skip(f"{' '.join(asked)}: {answer.stderr.decode().strip()}")
    docker("compose", "build", "--quiet", "prepare", "recorder", timeout_s=900)
    return IMAGE


@pytest.fixture(scope="session")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its actor and first pose are said, so that its first frame takes no longer than another."""
    folder = tmp_path_factory.mktemp("take") / "walk"
    write_take_of_known_actor(folder, n_frames=24, n_cameras=4)
    say_first_pose(folder)
    for path in (*folder.rglob("*"), folder, folder.parent, folder.parent.parent):
        path.chmod(0o755 if path.is_dir() else 0o644)  # services run as another user
    return folder


def _track(image: str, take: Path, folder: Path, *more: str) -> str:
    """poses.csv of local processes, in the image: code compiled for another processor rounds otherwise."""
    mounts = ["--volume", f"{take}:/take:ro", "--volume", f"{folder}:/results"]
    run = ["run", "--rm", "--user", f"{os.getuid()}:{os.getgid()}", *mounts, image]
    options = ("--out", "/results/result", "--no-overlay", "--backend", "cpu", *more)
    docker(*run, "track", "/take", *options, timeout_s=600)
    return (folder / "result" / "poses.csv").read_text()


@pytest.fixture(scope="session")
def local_poses(image: str, take: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """poses.csv of the take's first frames, tracked without compose."""
    return _track(image, take, tmp_path_factory.mktemp("local"), "--frames", FEW)


@pytest.fixture(scope="session")
def local_poses_by_plain_search(image: str, take: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Of all frames by a slow search, which take long enough to do something before the last."""
    return _track(image, take, tmp_path_factory.mktemp("plain"), *SLOWLY.split())


@pytest.fixture(scope="session")
def local_poses_of_eight(image: str, take: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Of the first frames by the usual search with eight workers: two to a limb, whose grid they divide."""
    return _track(image, take, tmp_path_factory.mktemp("eight"), "--frames", FEW, "--workers", "8")


@pytest.fixture
def slow_stack(image: str, take: Path, tmp_path: Path) -> Iterator[Stack]:  # noqa: ARG001
    """compose.yaml's services, which take some seconds for the take's frames."""
    settings = {"COORDINATOR_OPTIONS": SLOWLY, "RECORDER_OPTIONS": "--no-overlay"}
    with Stack(tmp_path / "out", TAKE=str(take), **settings) as made:
        yield made
