"""Services under fire: while a take is tracked, hostile messages come in at every socket.

The enemy is somebody who is let in, but says nothing that would be believed: it does not register as a worker
or recorder, and answers no open task.
"""

import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import msgpack
import zmq

from proto.framing import MalformedMessage, decode
from proto.messages import BlobRequest, Hello, Message, Recorded
from proto.sockets import bind, connect, make_socket, receive_from, take, wait
from proto.streams import StreamName, stream_endpoint
from services.launcher import Launcher, free_endpoint
from services.soak.dice import Dice
from services.soak.fuzz import rss_mib
from services.soak.hostile import Frames, Hostile
from services.soak.specimens import specimens
from services.soak.stage import make_take

_FRAMES = 24
_CAMERAS = 4
_PATIENCE_S = 240.0
_BURST = 200
_BREATH_S = 0.01
_LOOK_S = 0.1
_NO_FRAME = 100_000
"""A frame that no take here has."""
_TARGETS: dict[StreamName, int] = {"tasks": zmq.DEALER, "silhouettes": zmq.PUSH}


class BrokenServiceError(Exception):
    """A service did what it must not; the text says what."""


@dataclass
class Report:
    """What a siege has seen."""

    seed: int
    sent: Counter[str] = field(default_factory=Counter)
    """Messages by their target."""
    seconds: float = 0.0
    counted: str = ""
    """What the coordinator says that it has dropped."""
    growth_mib: dict[str, float] = field(default_factory=dict)
    """How much each service's memory grew under fire."""

    def as_json(self) -> dict[str, object]:
        """For a file."""
        told = {"seconds": self.seconds, "counted": self.counted, "growth_mib": self.growth_mib}
        return {"seed": self.seed, "sent": dict(self.sent), **told}


class _Fire:
    """Sends hostile messages to one socket."""

    def __init__(self, context: "zmq.Context[zmq.Socket[bytes]]", endpoint: str, stream: StreamName) -> None:
        self.socket = make_socket(context, _TARGETS[stream])
        self._monitor = self.socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
        connect(self.socket, stream_endpoint(endpoint, stream))

    @property
    def is_heard(self) -> bool:
        """Whether somebody has answered its handshake."""
        return bool(self._monitor.poll(0))

    def shoot(self, frames: Frames) -> bool:
        """Send without waiting; False where the queue is full."""
        while self.socket.type == zmq.DEALER and take(self.socket) is not None:
            pass  # answers are not what this is about
        return _sent(self.socket, frames)


def _sent(socket: "zmq.Socket[bytes]", frames: Frames) -> bool:
    try:
        socket.send_multipart(frames or [b""], flags=zmq.DONTWAIT)
    except zmq.Again:
        return False
    return True


def _registers(frames: Frames) -> bool:
    """Whether a message would make its sender a worker or recorder."""
    try:
        return isinstance(decode(frames), Hello | Recorded)
    except MalformedMessage:
        return False


def besiege(seed: int, messages: int) -> Report:
    """Fire so many messages at a worker and at a coordinator, which tracks a take twice, once in quiet.

    Raises BrokenServiceError where the fire shows, and what a Launcher raises where a service dies of it.
    """
    report, began_s = Report(seed), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="xormocap-soak-") as temporary:
        folder = Path(temporary)
        stage = make_take(folder / "siege", _FRAMES, _CAMERAS)
        _besiege_worker(folder, Hostile(Dice(seed, 1), "siege", _NO_FRAME), report, messages)
        quiet = _track(stage, folder / "quiet", None, report, 0)
        fired = _track(stage, folder / "fire", Hostile(Dice(seed, 2), "siege", _NO_FRAME), report, messages)
    if quiet != fired:
        raise BrokenServiceError(f"--seed {seed}: poses under fire differ from those of a quiet run")
    report.seconds = round(time.monotonic() - began_s, 1)
    return report


def _track(stage: Path, folder: Path, hostile: Hostile | None, report: Report, messages: int) -> str:
    """Track a take with one worker, under fire or not; returns poses.csv."""
    folder.mkdir()
    endpoint = free_endpoint()
    source, to = ("--take", str(stage)), ("--connect", endpoint)
    with Launcher(folder) as launcher:
        launcher.start("coordinator", *source, "--bind", endpoint, "--workers", "1", "--recorders", "1")
        if hostile is not None:
            _besiege_coordinator(launcher, endpoint, hostile, report, messages // 2)
        launcher.start("limb_worker", *to)
        launcher.start("segmentation", *source, *to)
        launcher.start("recorder", *source, *to, "--out", str(folder / "out"), "--no-overlay")
        if hostile is not None:
            _besiege_coordinator(launcher, endpoint, hostile, report, messages // 2)
        deadline_s = time.monotonic() + _PATIENCE_S
        while not launcher.has_ended("coordinator") or not launcher.has_ended("recorder"):
            launcher.watch()  # raises where a service has died
            if time.monotonic() > deadline_s:
                raise BrokenServiceError(f"--seed {report.seed}: the take did not end: {_last_words(folder)}")
            time.sleep(_LOOK_S)
    log = next(folder.glob("coordinator-*.log")).read_text()
    report.counted = next((line for line in log.splitlines() if " end: " in line), "").partition("end: ")[2]
    return (folder / "out" / "poses.csv").read_text()


def _last_words(folder: Path) -> str:
    """What each service has said last."""
    logs = {log.stem: log.read_text(errors="replace").splitlines() for log in sorted(folder.glob("*.log"))}
    return "; ".join(f"{name}: {lines[-1] if lines else 'nothing'}" for name, lines in logs.items())


def _besiege_coordinator(
    launcher: Launcher, endpoint: str, hostile: Hostile, report: Report, messages: int
) -> None:
    """Send hostile messages while there are some left and the coordinator is there to hear them.

    Its memory is looked at while it has nothing to track yet: that takes memory, too.
    """
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    fires = {name: _Fire(context, endpoint, name) for name in _TARGETS}
    memory = _Memory(launcher, "coordinator")
    _await_handshakes(fires, launcher)
    for sent in range(messages):
        frames = hostile.next()[1]
        while _registers(frames):
            frames = hostile.next()[1]
        for name, fire in fires.items():
            while not fire.shoot(frames) and not launcher.has_ended("coordinator"):
                time.sleep(_BREATH_S)
            report.sent[name] += 1
        if sent % _BURST == 0:
            launcher.watch()
            memory.look()
        if launcher.has_ended("coordinator"):
            break
    report.growth_mib.setdefault("coordinator", memory.growth_mib)
    context.destroy(linger=0)


def _await_handshakes(fires: dict[StreamName, _Fire], launcher: Launcher) -> None:
    """Wait until the coordinator listens, which it does once all of its program is loaded."""
    deadline_s = time.monotonic() + _PATIENCE_S
    while not fires["silhouettes"].is_heard:
        launcher.watch()
        if time.monotonic() > deadline_s:
            raise BrokenServiceError("the coordinator does not listen")
        time.sleep(_LOOK_S)


def _besiege_worker(folder: Path, hostile: Hostile, report: Report, messages: int) -> None:
    """Play a coordinator that has lost its mind; afterwards the worker must still listen to reason."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    router = make_socket(context, zmq.ROUTER)
    endpoint = free_endpoint()
    bind(router, stream_endpoint(endpoint, "tasks"))
    with Launcher(folder) as launcher:
        launcher.start("limb_worker", "--connect", endpoint)
        identity = _await(router, launcher, Hello)
        memory = _Memory(launcher, "limb_worker")
        for sent in range(messages):
            frames = [identity, *hostile.next()[1]]
            while not _sent(router, frames):
                launcher.watch()
                time.sleep(_BREATH_S)
            while take(router) is not None:
                pass
            report.sent["limb_worker"] += 1
            if sent % _BURST == 0:
                launcher.watch()
                memory.look()
        asked = _await(router, launcher, BlobRequest, _task_without_content(identity))
        if asked != identity:
            raise BrokenServiceError(f"--seed {report.seed}: the worker had to register again")
        report.growth_mib["limb_worker"] = memory.growth_mib
    context.destroy(linger=0)


def _task_without_content(identity: bytes) -> Frames:
    """A task that names content which the worker cannot have, so that it asks for it."""
    header = msgpack.unpackb(specimens("siege", 0)["limb_task"][0]) | {"actor": "a" * 64}
    return [identity, msgpack.packb(header), *specimens("siege", 0)["limb_task"][1:]]


def _await(
    router: "zmq.Socket[bytes]", launcher: Launcher, wanted: type[Message], ask: Frames | None = None
) -> bytes:
    """Who sends a message of a type at last, having been asked for it again and again."""
    deadline_s = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline_s:
        launcher.watch()
        if ask is not None:
            _sent(router, ask)
        wait([router], _LOOK_S)
        while (arrived := receive_from(router)) is not None:
            message = arrived[1]
            if isinstance(message, wanted) and getattr(message, "hash", "a" * 64) == "a" * 64:
                return arrived[0]
    raise BrokenServiceError(f"the worker did not send {wanted.type}")


class _Memory:
    """Follows the memory of a service's process."""

    def __init__(self, launcher: Launcher, name: str) -> None:
        self._launcher, self._name = launcher, name
        self._seen_mib: list[float] = []

    def look(self) -> None:
        """Note what it takes now."""
        with suppress(OSError, IndexError):  # it may just have ended
            self._seen_mib.append(rss_mib(self._launcher.pids(self._name)[0]))

    @property
    def growth_mib(self) -> float:
        """The end's over the first tenth's, by when everything has been in use."""
        seen = self._seen_mib
        return round(seen[-1] - max(seen[: 1 + len(seen) // 10]), 1) if seen else 0.0
