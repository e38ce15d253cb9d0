"""compose.yaml tracks takes as local processes do, whatever happens to its services meanwhile."""

import json
import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from stack import Stack, docker, pause, wait_until

pytestmark = [pytest.mark.containers, pytest.mark.timeout(1200), pytest.mark.usefixtures("image")]


@pytest.fixture
def stack(take: Path, tmp_path: Path) -> Iterator[Stack]:
    with Stack(tmp_path / "out", TAKE=str(take), RECORDER_OPTIONS="--no-overlay") as made:
        yield made


def test_up_tracks_a_take_and_returns(stack: Stack, local_poses: str) -> None:
    stack.compose("up", "--no-build", timeout_s=240)
    assert stack.is_over()
    assert stack.finish()["speed"]["workers"] == 4
    assert stack.poses() == local_poses
    assert (stack.out / "result" / "report.html").exists()
    for worker in stack.containers("limb-worker"):
        assert stack.inspect(worker)["Health"]["Status"] == "healthy", "workers stay for the next take"


def test_the_page_opens_for_whoever_has_the_token(stack: Stack) -> None:
    stack.start()
    viewer = stack.one("viewer")
    wait_until(lambda: stack.inspect(viewer)["Health"]["Status"] == "healthy", stack.logs)
    address = re.search(r"http://\S+\?token=\S+", stack.logs("prepare"))
    assert address is not None
    assert address[0].startswith(f"http://127.0.0.1:{stack.page_port}/?token=")
    with pytest.raises(urllib.error.HTTPError, match="401"):
        urllib.request.urlopen(f"http://127.0.0.1:{stack.page_port}/", timeout=20)
    browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with browser.open(address[0], timeout=20) as page:
        assert b"viser" in page.read().lower()
    stack.finish()
    assert stack.inspect(viewer)["Health"]["Status"] == "healthy", "it stays for the next take"


def test_eight_workers(take: Path, tmp_path: Path, local_poses_of_eight: str) -> None:
    options = {"RECORDER_OPTIONS": "--no-overlay", "FRAMES": "0:6", "COORDINATOR_OPTIONS": "--workers 8"}
    with Stack(tmp_path / "out", TAKE=str(take), **options) as stack:
        stack.start("--scale", "limb-worker=8")
        assert stack.finish()["speed"]["workers"] == 8
        assert stack.poses() == local_poses_of_eight


def test_deaths_hangs_and_cuts_change_no_frame(slow_stack: Stack, local_poses_by_plain_search: str) -> None:
    stack = slow_stack
    stack.start("--scale", "limb-worker=7")  # from eight on, poses depend on how many there are
    workers = stack.containers("limb-worker")
    stack.until_solved(2)

    docker("kill", workers[0])
    pause(workers[1])
    docker("network", "disconnect", stack.network, workers[2])
    docker("kill", stack.one("recorder"))
    stack.until_solved(8)

    docker("start", stack.one("recorder"))  # an engine restarts what died, not what somebody killed
    docker("kill", stack.one("segmentation"))
    docker("start", stack.one("segmentation"))
    docker("unpause", workers[1])
    docker("network", "connect", stack.network, workers[2])
    docker("start", workers[0])
    assert not stack.is_over(), "all of this was to happen in mid-take"

    report = stack.finish()
    assert stack.poses() == local_poses_by_plain_search
    assert report["speed"]["retries"] > 0


def test_a_service_that_dies_by_itself_is_started_again(
    slow_stack: Stack, local_poses_by_plain_search: str
) -> None:
    stack = slow_stack
    stack.start()
    stack.until_solved(2)
    killed = ("segmentation", "recorder", "limb-worker")
    for service in killed:
        stack.compose("exec", service, "sh", "-c", "kill -KILL $(cat /proc/1/task/1/children)")
    stack.finish()
    assert stack.poses() == local_poses_by_plain_search
    assert [json.loads(docker("inspect", "-f", "{{.RestartCount}}", stack.one(s))) for s in killed] == [1] * 3
