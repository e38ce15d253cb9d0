"""Who gets in to compose.yaml's services: who was added, and none with a wrong, a revoked or no key."""

import os
import shutil
from pathlib import Path

import pytest
from stack import Stack, docker, wait_until

pytestmark = [pytest.mark.containers, pytest.mark.timeout(1200)]


@pytest.fixture
def misled(slow_stack: Stack, tmp_path: Path) -> Path:
    """Keys of workers that do not get in: revoked ones, and ones that take another for the coordinator."""
    slow_stack.start()
    slow_stack.hold()
    slow_stack.keys("add", "friend", "revoked")
    folder = tmp_path / "keys"
    folder.mkdir(mode=0o700)
    docker("cp", f"{slow_stack.one('coordinator')}:/keys/revoked", folder / "revoked")
    slow_stack.keys("revoke", "revoked")
    slow_stack.compose("kill", "--signal", "HUP", "coordinator")
    docker("cp", f"{slow_stack.one('coordinator')}:/keys/friend", folder / "stranger")
    shutil.copy(folder / "revoked" / "client.key", folder / "stranger" / "server.key")  # some other key
    for path in (*folder.rglob("*"), folder):
        os.chown(path, *map(int, slow_stack.user.split(":")))
    return folder


def test_only_workers_on_the_list_get_in(
    slow_stack: Stack, misled: Path, local_poses_by_plain_search: str
) -> None:
    stack = slow_stack
    others = {
        stack.worker(""): "needs keys: give --keys DIR",
        stack.worker(
            "stranger", str(misled)
        ): "server.key beside this service's keys is not this coordinator's",
        stack.worker("revoked", str(misled)): "refuses this service's key",
    }
    friend = stack.worker("friend")
    wait_until(lambda: f"@{friend[:12]}:" in stack.logs("coordinator"), stack.logs)
    for container, said in others.items():
        wait_until(lambda c=container, s=said: s in stack.logs_of(c), lambda c=container: stack.logs_of(c))
    assert not stack.is_over(), "all of this was to happen in mid-take"

    stack.go_on()
    stack.finish()
    assert stack.poses() == local_poses_by_plain_search
    for container in others:
        assert f"@{container[:12]}:" not in stack.logs("coordinator")
