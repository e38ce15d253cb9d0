"""`xormocap play`: sends the poses of finished results to animation tools."""

import time
from collections.abc import Iterator
from itertools import count
from typing import Annotated

import typer

from services.bridge.humanoid import bones_of
from services.bridge.vmc import frame, nobody_tracked, open_sender
from services.commands.consoles import ResultFolder, say
from services.mocap.result.result import Result, load_result
from services.process import StopRequest

_LONGEST_SLEEP_S = 0.1
"""So that Ctrl-C is answered at once."""
_LATE_S = 0.25
"""Frames that are later than this, as after a sleep of the machine, are left out."""


def play(
    result: ResultFolder,
    vmc: Annotated[
        str, typer.Option("--vmc", metavar="HOST:PORT", help="Where a tool receives the VMC protocol (UDP).")
    ],
    speed: Annotated[float, typer.Option(min=0.01, max=100.0, help="Speed relative to the recording.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end, until Ctrl-C.")] = False,
) -> None:
    """Send the poses of results to animation tools that receive the VMC protocol, at the take's own speed."""
    send, found = open_sender(vmc), load_result(result)
    offsets_m = found.motion.body.offsets_m
    bones_of(found.poses[0], offsets_m)  # the first call loads compiled code, which would make frames late
    with StopRequest() as stop:
        again = f"every {len(found.frames) / found.fps / speed:.1f} s again, until Ctrl-C" if loop else "once"
        say(f"sending {len(found.frames)} frames to {vmc}, {again}")
        began_s, sent = time.monotonic(), 0
        for row, at_s in _schedule(found, loop):
            due_s = began_s + at_s / speed
            if not _wait_until(due_s, stop):
                break
            if time.monotonic() < due_s + _LATE_S:
                bones = bones_of(found.poses[row], offsets_m)
                send(frame(at_s, bones, is_trusted=not found.distrusted[row].any()))
                sent += 1
        send(nobody_tracked())
    say(f"sent {sent} frames")


def _schedule(result: Result, loop: bool) -> Iterator[tuple[int, float]]:
    """Each frame's row, and its time in seconds, which goes on where the take begins again."""
    times_s = (result.times_s - result.times_s[0]).tolist()
    length_s = times_s[-1] + 1 / result.fps
    for rounds in count() if loop else range(1):
        for row, time_s in enumerate(times_s):
            yield row, rounds * length_s + time_s


def _wait_until(due_s: float, stop: StopRequest) -> bool:
    """Sleep until a time of time.monotonic; False after a request to stop."""
    while not stop:
        rest_s = due_s - time.monotonic()
        if rest_s <= 0:
            return True
        time.sleep(min(rest_s, _LONGEST_SLEEP_S))
    return False
