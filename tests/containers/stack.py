"""compose.yaml's services under a name of their own, watched from this machine as a viewer watches them."""

import json
import os
import re
import secrets
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import zmq

from proto.keys import client_keys
from proto.link import Line
from proto.messages import Pose
from proto.sockets import receive, wait

ROOT = Path(__file__).resolve().parents[2]
IMAGE, PAGE_IMAGE = "xormocap:test", "xormocap:test-page"
SLOWLY = "--search plain --set detail_px=0.5 --set arm_grid=[7,7,3,7] --set leg_grid=[7,7,3,7]"
"""Options of a coordinator whose frames are to take long enough to do something before the last."""
FEW = "0:8"
"""The frames of runs in which nothing is done meanwhile."""
_LOOK_S = 0.2
_PAUSE_TRIES = 8


def docker(*arguments: object, timeout_s: float = 200, env: dict[str, str] | None = None) -> str:
    """Run docker to its end; what it printed. A command that fails fails the test."""
    command = ["docker", *map(str, arguments)]
    environment = {**os.environ, "XORMOCAP_IMAGE": IMAGE, "XORMOCAP_PAGE_IMAGE": PAGE_IMAGE, **(env or {})}
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=timeout_s, check=False
    )
    assert done.returncode == 0, f"{' '.join(command)}:\n{done.stdout}{done.stderr}"
    return done.stdout.strip()


def pause(container: str) -> None:
    """Freeze a container; where an engine still uses cgroups v1, that fails now and then for a busy one."""
    for _ in range(_PAUSE_TRIES - 1):
        try:
            docker("pause", container)
        except AssertionError:
            continue
        return
    docker("pause", container)


def wait_until(condition: Callable[[], bool], what: Callable[[], str], timeout_s: float = 120) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what()
        time.sleep(_LOOK_S)


class Stack:
    """One run of compose.yaml; a context manager that leaves nothing behind."""

    def __init__(self, out: Path, *overrides: str, **settings: str) -> None:
        """overrides: compose files beside compose.yaml."""
        self.out, self._name = out, f"xormocap-test-{secrets.token_hex(3)}"
        self._files = [word for name in ("compose.yaml", *overrides) for word in ("-f", name)]
        self.user = f"{os.getuid() or 1000}:{os.getgid() or 1000}"
        """Who the services run as; root's as somebody else."""
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.page_port: int = free.getsockname()[1]
        self._env = {
            "OUT": str(out),
            "XORMOCAP_USER": self.user,
            "XORMOCAP_BACKEND": "cpu",
            "VIEWER": f"127.0.0.1:{self.page_port}",
            **settings,
        }
        self._keys = out.parent / f"{out.name}-keys"
        self._others: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._others:
            docker("rm", "--force", *self._others)
        self.compose("down", "--volumes", "--timeout", "2")

    def compose(self, *arguments: object, timeout_s: float = 200) -> str:
        options = ("-p", self._name, *self._files)
        return docker("compose", *options, *arguments, env=self._env, timeout_s=timeout_s)

    def start(self, *options: str) -> None:
        """Start all services in the background."""
        self.compose("up", "--detach", "--no-build", *options)

    def containers(self, service: str) -> list[str]:
        """Ids of a service's containers, running or not."""
        return self.compose("ps", "--all", "--quiet", service).split()

    def one(self, service: str) -> str:
        return self.containers(service)[0]

    def inspect(self, container: str, field: str = "State") -> dict[str, Any]:
        found: dict[str, Any] = json.loads(docker("inspect", "--format", f"{{{{json .{field}}}}}", container))
        return found

    @property
    def network(self) -> str:
        return f"{self._name}_default"

    def logs(self, *services: str) -> str:
        return self.compose("logs", "--no-color", *services)

    def kill_within(self, container: str) -> None:
        """Have a container's process die as it would by itself."""
        docker("exec", container, "sh", "-c", "kill -KILL $(cat /proc/1/task/1/children)")

    def restarts(self, container: str) -> int:
        """How often the engine has started a container again by itself."""
        return int(docker("inspect", "--format", "{{.RestartCount}}", container))

    def logs_of(self, container: str) -> str:
        """What a container that compose did not start has said."""
        done = subprocess.run(["docker", "logs", container], capture_output=True, text=True, check=True)
        return done.stdout + done.stderr

    def add_keys(self, name: str) -> None:
        """Make keys of a further service in the volume of keys, as whoever runs the services."""
        volume = f"{self._name}_keys:/keys"
        docker("run", "--rm", "--user", self.user, "--volume", volume, IMAGE, "keys", "add", "/keys", name)

    def worker(self, name: str) -> str:
        """Start a limb worker beside compose's, with these keys of the volume; its container."""
        run = ("run", "--detach", "--network", self.network, "--user", self.user)
        mount = ("--volume", f"{self._name}_keys:/keys:ro")
        command = ("limb_worker", "--connect", "tcp://coordinator:5550", "--keys", f"/keys/{name}")
        self._others.append(docker(*run, *mount, IMAGE, *command))
        return self._others[-1]

    def hold(self) -> None:
        """Let the take come no further than the coordinator's credit (8 frames), however fast the machine."""
        docker("kill", self.one("segmentation"))

    def go_on(self) -> None:
        """Let a held take come to its end; the engine restarts what died, not what somebody killed."""
        docker("start", self.one("segmentation"))

    def until_solved(self, frames: int, timeout_s: float = 120) -> None:
        """Wait until the coordinator has published so many frames, as a client with keys sees it."""
        coordinator = self.one("coordinator")
        if not self._keys.exists():
            docker("cp", f"{coordinator}:/keys/viewer", self._keys)
        address = self.inspect(coordinator, "NetworkSettings")["Networks"][self.network]["IPAddress"]
        assert address, self.logs()  # the coordinator has ended
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        line = Line(context, f"tcp://{address}:5550", "poses", client_keys(self._keys, "viewer"))
        deadline_s, solved = time.monotonic() + timeout_s, 0
        while solved < frames:
            assert time.monotonic() < deadline_s, self.logs()
            wait([line.socket], _LOOK_S)
            while (message := receive(line.socket)) is not None:
                if isinstance(message, Pose):
                    solved = max(solved, message.frame + 1)
            line.tick()
        line.close()
        context.term()

    def is_over(self) -> bool:
        """Whether the coordinator has ended."""
        return bool(self.inspect(self.one("coordinator"))["Status"] == "exited")

    def finish(self) -> dict[str, Any]:
        """Wait for the recorder's good end; its run.json."""
        wait_until(lambda: self.inspect(self.one("recorder"))["Status"] == "exited", self.logs, 240)
        assert self.inspect(self.one("recorder"))["ExitCode"] == 0, self.logs()
        report: dict[str, Any] = json.loads((self.out / "result" / "run.json").read_text())
        return report

    def workers_that_came(self) -> set[str]:
        """The limb workers that the coordinator has welcomed, by name.

        How many are there at the end is up to the machine: a worker may lose its connection for a moment
        where ten containers share two cores.
        """
        return set(re.findall(r"limb_worker\S+(?= says hello)", self.logs("coordinator")))

    def poses(self) -> str:
        return (self.out / "result" / "poses.csv").read_text()


class Pool:
    """One run of docker/compose.pool.yaml: limb workers for stacks of the names that it knows."""

    def __init__(self, *slots: str) -> None:
        self.name = f"xormocap-test-{secrets.token_hex(3)}"
        endpoints = " ".join(f"tcp://{slot}:5550" for slot in slots)
        user = f"{os.getuid() or 1000}:{os.getgid() or 1000}"
        self._env = {
            "POOL": endpoints,
            "POOL_NAME": self.name,
            "XORMOCAP_USER": user,
            "XORMOCAP_BACKEND": "cpu",
        }

    def _compose(self, *arguments: object) -> str:
        options = ("-p", self.name, "-f", "docker/compose.pool.yaml")
        return docker("compose", *options, *arguments, env=self._env)

    def __enter__(self) -> Self:
        self._compose("up", "--detach", "--no-build")
        return self

    def __exit__(self, *_: object) -> None:
        self._compose("down", "--volumes", "--timeout", "2")
