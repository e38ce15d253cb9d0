"""Services under fire: while a take is tracked, hostile messages come in at every socket.

The enemy is somebody who is let in, but says nothing that would be believed: it does not register as a worker
or recorder, and answers no open task.
"""

import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import zmq

from bench.soak.dice import Dice
from bench.soak.fire import BREATH_S, BURST, LOOK_S, PATIENCE_S, TARGETS, BrokenServiceError, Fire, Memory
from bench.soak.hostile import Frames, Hostile
from bench.soak.limb_worker_fuzz import fuzz_limb_worker
from bench.soak.stage import make_take
from proto.framing import MalformedMessage, decode
from proto.messages import Hello, Recorded
from proto.streams import StreamName
from services.runs.launcher import Launcher, free_endpoint

_FRAMES = 24
_CAMERAS = 4
_NO_FRAME = 100_000
"""A frame that no take here has."""


@dataclass
class Report:
    """What the fuzzing has seen."""

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


def _registers(frames: Frames) -> bool:
    """Whether a message would make its sender a worker or recorder."""
    try:
        return isinstance(decode(frames), Hello | Recorded)
    except MalformedMessage:
        return False


def fuzz_sockets(seed: int, messages: int, frames: int = _FRAMES) -> Report:
    """Fire so many messages at a worker and at a coordinator, which tracks a take twice, once in quiet.

    Raises BrokenServiceError where the fire shows, and what a Launcher raises where a service dies of it.
    """
    report, began_s = Report(seed), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="xormocap-soak-") as temporary:
        folder = Path(temporary)
        stage = make_take(folder / "fuzz", frames, _CAMERAS)
        enemy = Hostile(Dice(seed, 1), "fuzz", _NO_FRAME)
        report.growth_mib["limb_worker"] = fuzz_limb_worker(folder, enemy, seed, messages)
        report.sent["limb_worker"] += messages
        quiet = _track(stage, folder / "quiet", None, report, 0)
        fired = _track(stage, folder / "fire", Hostile(Dice(seed, 2), "fuzz", _NO_FRAME), report, messages)
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
        expected = ("--workers", "1", "--recorders", "1", "--set", "both_ways=false")
        launcher.start("coordinator", *source, "--bind", endpoint, *expected)
        if hostile is not None:
            _fuzz_coordinator(launcher, endpoint, hostile, report, messages // 2)
        launcher.start("limb_worker", *to)
        launcher.start("segmentation", *source, *to)
        bare = ("--no-overlay", "--no-report")
        launcher.start("recorder", *source, *to, "--out", str(folder / "out"), *bare)
        if hostile is not None:
            _fuzz_coordinator(launcher, endpoint, hostile, report, messages // 2)
        deadline_s = time.monotonic() + PATIENCE_S
        while not launcher.has_ended("coordinator") or not launcher.has_ended("recorder"):
            launcher.watch()  # raises where a service has died
            if time.monotonic() > deadline_s:
                raise BrokenServiceError(f"--seed {report.seed}: the take did not end: {_last_words(folder)}")
            time.sleep(LOOK_S)
    log = next(folder.glob("coordinator-*.log")).read_text()
    report.counted = next((line for line in log.splitlines() if " end: " in line), "").partition("end: ")[2]
    return (folder / "out" / "poses.csv").read_text()


def _last_words(folder: Path) -> str:
    """What each service has said last."""
    logs = {log.stem: log.read_text(errors="replace").splitlines() for log in sorted(folder.glob("*.log"))}
    return "; ".join(f"{name}: {lines[-1] if lines else 'nothing'}" for name, lines in logs.items())


def _fuzz_coordinator(
    launcher: Launcher, endpoint: str, hostile: Hostile, report: Report, messages: int
) -> None:
    """Send hostile messages while there are some left and the coordinator is there to hear them.

    Its memory is looked at while it has nothing to track yet: that takes memory, too.
    """
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    fires = {name: Fire(context, endpoint, name) for name in TARGETS}
    memory = Memory(launcher, "coordinator")
    _await_handshakes(fires, launcher)
    for sent in range(messages):
        frames = hostile.next()[1]
        while _registers(frames):
            frames = hostile.next()[1]
        for name, fire in fires.items():
            while not fire.shoot(frames) and not launcher.has_ended("coordinator"):
                time.sleep(BREATH_S)
            report.sent[name] += 1
        if sent % BURST == 0:
            launcher.watch()
            memory.look()
        if launcher.has_ended("coordinator"):
            break
    report.growth_mib.setdefault("coordinator", memory.growth_mib)
    context.destroy(linger=0)


def _await_handshakes(fires: dict[StreamName, Fire], launcher: Launcher) -> None:
    """Wait until the coordinator listens, which it does once all of its program is loaded."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not fires["silhouettes"].is_heard:
        launcher.watch()
        if time.monotonic() > deadline_s:
            raise BrokenServiceError("the coordinator does not listen")
        time.sleep(LOOK_S)
