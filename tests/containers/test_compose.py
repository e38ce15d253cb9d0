"""compose.yaml tracks takes as local processes do, whatever happens to its services meanwhile."""

import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from stack import FEW, SLOWLY, Pool, Stack, docker, pause, wait_until

pytestmark = [pytest.mark.containers, pytest.mark.timeout(1200), pytest.mark.usefixtures("image")]


@pytest.fixture
def stack(take: Path, tmp_path: Path) -> Iterator[Stack]:
    settings = {"RECORDER_OPTIONS": "--no-overlay", "WORKERS": "8", "FRAMES": FEW}
    with Stack(tmp_path / "out", TAKE=str(take), **settings) as made:
        yield made


def test_the_image_has_everything_compiled(image: str) -> None:
    script = (
        "entrypoint --version && touch /tmp/begun && entrypoint compile"
        " && find /tmp/xormocap -newer /tmp/begun && ls -R /app/warm"
    )
    printed = docker("run", "--rm", "--entrypoint", "sh", image, "-c", script).splitlines()
    assert [line for line in printed if re.search(r"/xormocap/.*\.nb[ci]$", line)] == []
    assert sum(line.endswith(".nbc") for line in printed) > 100


def test_up_tracks_a_take_with_eight_workers_and_returns_and_the_page_stays(
    stack: Stack, local_poses_of_eight: str
) -> None:
    stack.compose("up", "--no-build", timeout_s=400)
    assert stack.is_over()
    stack.finish()
    assert len(stack.workers_that_came()) == 8, stack.logs("coordinator", "limb-worker")
    assert stack.poses() == local_poses_of_eight
    assert (stack.out / "result" / "report.html").exists()
    for worker in stack.containers("limb-worker"):
        assert stack.inspect(worker)["Health"]["Status"] == "healthy", "workers stay for the next take"
    see_the_page(stack)


def see_the_page(stack: Stack) -> None:
    """Look at the page by the address that is told, and without the token."""
    viewer = stack.one("viewer")
    wait_until(lambda: stack.inspect(viewer)["Health"]["Status"] == "healthy", stack.logs)
    address = re.search(r"http://\S+\?token=\S+", stack.logs("prepare"))
    assert address is not None
    assert address[0].startswith(f"http://127.0.0.1:{stack.page_port}/?token=")
    with pytest.raises(urllib.error.HTTPError, match="401"):
        urllib.request.urlopen(f"http://127.0.0.1:{stack.page_port}/", timeout=20)
    browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with browser.open(address[0], timeout=20) as page:
        assert b"xormocap" in page.read().lower()


def test_deaths_hangs_and_cuts_change_no_frame(slow_stack: Stack, local_poses_by_plain_search: str) -> None:
    """One run, in which everything happens in turn: the slowest part of all is to start the services."""
    stack = slow_stack
    stack.start("--scale", "limb-worker=4")  # no more than limbs: whoever is hurt is missed
    workers = stack.containers("limb-worker")
    stack.until_solved(2)

    docker("kill", workers[0])
    pause(workers[1])
    docker("network", "disconnect", stack.network, workers[2])
    docker("kill", stack.one("recorder"))
    stack.until_solved(6)
    stack.hold()
    forgotten = [f"forgot limb_worker@{worker[:12]}:" for worker in workers[:3]]
    wait_until(lambda: all(words in stack.logs("coordinator") for words in forgotten), stack.logs)

    stack.add_keys("friend")
    friend = stack.worker("friend")
    wait_until(lambda: "refuses this service's key" in stack.logs_of(friend), lambda: stack.logs_of(friend))
    stack.compose("kill", "--signal", "HUP", "coordinator")  # reads the list again
    wait_until(lambda: any(friend[:12] in name for name in stack.workers_that_came()), stack.logs)

    docker("start", stack.one("recorder"))
    docker("unpause", workers[1])
    docker("network", "connect", stack.network, workers[2])
    docker("start", workers[0])
    stack.go_on()
    stack.until_solved(10)

    docker("kill", stack.one("coordinator"))
    docker("start", stack.one("coordinator"))
    stack.until_solved(13)
    assert "continuing run" in stack.logs("coordinator")

    by_themselves = [*map(stack.one, ("segmentation", "recorder", "coordinator")), workers[3]]
    for container in by_themselves:
        stack.kill_within(container)
    assert not stack.is_over(), "all of this was to happen in mid-take"

    stack.finish()
    assert stack.poses() == local_poses_by_plain_search
    assert [*map(stack.restarts, by_themselves)] == [1] * len(by_themselves)


def test_two_takes_share_a_pool_of_workers(
    take: Path, tmp_path: Path, local_poses: str, local_poses_by_plain_search: str
) -> None:
    quiet = {"TAKE": str(take), "RECORDER_OPTIONS": "--no-overlay --no-report"}
    with Pool("one", "two") as pool, ExitStack() as stacks:
        settings = quiet | {"POOL_NAME": pool.name}
        options = {"one": {"FRAMES": FEW}, "two": {"COORDINATOR_OPTIONS": SLOWLY, "FRAMES": "0:6"}}
        both = [
            stacks.enter_context(
                Stack(tmp_path / slot, "docker/compose.take.yaml", SLOT=slot, **settings, **more)
            )
            for slot, more in options.items()
        ]
        for stack in both:
            stack.start()
            assert stack.containers("limb-worker") == []
        reports = [stack.finish() for stack in both]
        assert [len(stack.workers_that_came()) for stack in both] == [4, 4]
        assert reports[1]["settings"]["worker_limbs_by_backend"]["cpu"] > 0
        assert both[0].poses() == local_poses
        assert both[1].poses().splitlines() == local_poses_by_plain_search.splitlines()[:7]
