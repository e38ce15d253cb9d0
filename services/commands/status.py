"""`xormocap status`: the state of a run's services, from the coordinator's telemetry."""

import socket
import sys
import time
from collections import deque
from contextlib import closing
from typing import Annotated, Literal

import typer
from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from proto.framing import MalformedMessage
from proto.keys import ClientKeys
from proto.messages import OPEN_END, Message, Pose, TakeEnd, Telemetry
from proto.streams import DEFAULT_ENDPOINT, PUBLISHED, stream_endpoint
from services.commands.consoles import stdout
from services.listener import PosesListener
from services.mocap.errors import UserError
from services.mocap.result.words import rate_in_words
from services.options import KeysOption, keys_of_client

_CONNECT_S = 0.25
"""How long one attempt to connect may take."""
_READ_S = 0.25
"""How long it waits for messages before it updates the table."""
_REACHED_S = 1.5
"""How long it waits for a host that does not answer; one that refuses the connection is not waited for."""
_TELEMETRY_WAIT_S = 30.0
"""How long it waits for telemetry once somebody listens there; while a coordinator finds the first pose, it
sends none for some seconds."""
_RATE_FRAMES = 30
_IN_MS = "{:.1f}".format


class Watch(PosesListener):
    """Follows what a coordinator tells of itself."""

    def __init__(self, endpoint: str, keys: ClientKeys | None) -> None:
        super().__init__(endpoint, keys)
        self._took_s: deque[float] = deque(maxlen=_RATE_FRAMES)
        self.latest: Telemetry | None = None

    def take_in(self, message: Message) -> None:
        """Remember the newest."""
        if isinstance(message, Telemetry):
            self.latest = message
        elif isinstance(message, TakeEnd) and self.latest is not None:
            self.latest = self.latest.model_copy(update={"stage": "ended"})
        elif isinstance(message, Pose):
            self._took_s.append(message.seconds.get("frame", 0.0))

    def refuse(self, error: MalformedMessage) -> None:
        """Raises UserError."""
        raise UserError(f"malformed telemetry: {error}: does the coordinator have another version?")

    @property
    def silent_s(self) -> float:
        """Seconds since the last message."""
        return time.monotonic() - self.heard_s

    @property
    def frames_per_s(self) -> float | None:
        """Frame rate of the last frames; None if there were none."""
        total_s = sum(self._took_s)
        return len(self._took_s) / total_s if total_s > 0 else None


def as_table(telemetry: Telemetry, frames_per_s: float | None, silent_s: float) -> RenderableType:
    """The state as tables for a person."""
    done = f"{telemetry.next_frame - telemetry.first_frame}"
    if telemetry.end_frame < OPEN_END:
        done += f" of {telemetry.end_frame - telemetry.first_frame}"
    speed = "" if frames_per_s is None else f", {rate_in_words(frames_per_s)}"
    head = Text(f"{telemetry.take}: {telemetry.stage}, {done} frames{speed}")
    if silent_s > PUBLISHED.silence_s:
        head.append(f"; nothing heard for {silent_s:.0f} s", style="yellow")
    live: list[RenderableType] = [Text(), _cameras(telemetry)] if telemetry.drops else []
    return Group(head, Text(), _services(telemetry), *live, Text(), _numbers(telemetry))


def _services(telemetry: Telemetry) -> Table:
    """The services, and what they are doing."""
    table = Table("service", "where", "backend", "doing", box=None, header_style="bold")
    table.add_row("segmentation", "", "", f"{telemetry.frames_ready} frames ready")
    for name, backend in sorted(telemetry.workers.items()):
        role, _, where = name.partition("@")
        limb = telemetry.limbs.get(name)
        table.add_row(Text(role), Text(where), Text(backend), limb.replace("_", " ") if limb else "idle")
    for name, end in sorted(telemetry.recorders.items()):
        role, _, where = name.partition("@")
        table.add_row(Text(role), Text(where), "", f"{max(end - telemetry.first_frame, 0)} frames on disk")
    return table


def _cameras(telemetry: Telemetry) -> Table:
    """Live cameras, and what was dropped of each; where it was dropped shows what to improve."""
    table = Table(
        "camera", "dropped by source", "by segmentation", "by tracking", box=None, header_style="bold"
    )
    for name, counts in telemetry.drops.items():
        where = Text(name, style="red") if name in telemetry.absent else Text(name)
        table.add_row(where + (" is absent" if name in telemetry.absent else ""), *map(str, counts))
    return table


def _numbers(telemetry: Telemetry) -> Table:
    """Milliseconds of the last frame, queues, drops."""
    table = Table(show_header=False, box=None)
    stages = [f"{name.replace('_', ' ')} {_IN_MS(1000 * s)}" for name, s in telemetry.seconds.items()]
    table.add_row("last frame, ms", Text(", ".join(stages) or "none yet"))
    if telemetry.latency_s:
        median_ms, p95_ms = (_IN_MS(1000 * telemetry.latency_s[name]) for name in ("median", "p95"))
        table.add_row("shutter to pose, ms", f"median {median_ms}, 95 % below {p95_ms}")
    table.add_row("limb tasks waiting", f"{telemetry.tasks_waiting}; deadline {telemetry.deadline_s:.2f} s")
    table.add_row("frames not on disk", f"{telemetry.unrecorded}")
    for name, count in telemetry.counts.items():
        style = "yellow" if count and name != "retries" else ""
        table.add_row(Text(name.replace("_", " ")), Text(f"{count}", style=style))
    return table


def status(
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    once: Annotated[bool, typer.Option("--once", help="Print the state once and exit.")] = False,
    in_json: Annotated[
        bool, typer.Option("--json", help="Print the state once, as one line of JSON.")
    ] = False,
    keys: KeysOption = None,
) -> None:
    """Show the state of a run's services in a live table, until the run ends."""
    with closing(Watch(connect, keys_of_client(keys, "viewer"))) as watch:
        telemetry = _first_telemetry(watch, connect)
        if in_json:
            sys.stdout.write(telemetry.model_dump_json() + "\n")
        elif once:
            stdout.print(as_table(telemetry, watch.frames_per_s, watch.silent_s))
        else:
            _follow(watch, telemetry)


def _first_telemetry(watch: Watch, endpoint: str) -> Telemetry:
    """The coordinator's first telemetry; raises UserError where nobody listens or no telemetry comes."""
    began_s, answer = time.monotonic(), ""
    while watch.latest is None:
        waited_s = time.monotonic() - began_s
        answer = answer if answer == "listens" else answer_of(endpoint)
        if answer == "refuses" or (answer == "silent" and waited_s > _REACHED_S):
            raise UserError(
                f"{endpoint}: no run answers there: start one by xormocap track TAKE --endpoint {endpoint}, "
                "or give the address of another by --connect"
            )
        if waited_s > _TELEMETRY_WAIT_S:
            raise UserError(f"{endpoint}: no telemetry: is this the address of a coordinator?")
        watch.listen(_READ_S)
    return watch.latest


def answer_of(endpoint: str) -> Literal["listens", "refuses", "silent"]:
    """What happens to a connection to where a coordinator publishes its poses."""
    host, _, port = stream_endpoint(endpoint, "poses").removeprefix("tcp://").rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S):
            return "listens"
    except ConnectionRefusedError:
        return "refuses"
    except OSError:
        return "silent"


def _follow(watch: Watch, telemetry: Telemetry) -> None:
    """Update the table until the run has ended and its coordinator has exited."""
    with Live(as_table(telemetry, None, 0.0), auto_refresh=False) as live:
        while telemetry.stage != "ended" or watch.silent_s < PUBLISHED.silence_s:
            watch.listen(_READ_S)
            telemetry = watch.latest or telemetry
            live.update(as_table(telemetry, watch.frames_per_s, watch.silent_s), refresh=True)
