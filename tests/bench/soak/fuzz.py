"""The protocol's decoder under fire: it must refuse or understand, in time, and keep nothing."""

import os
import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from bench.soak.dice import Dice
from bench.soak.hostile import Frames, Hostile
from proto.framing import MalformedMessage, decode, encode

_ROUND = 10_000
"""Inputs by one pair of dice: any can be made again without all before it."""
_LONGEST_REASON = 300


class BrokenDecoderError(Exception):
    """The decoder did what it must not; the text says with which input."""


@dataclass
class Report:
    """What a run has seen."""

    seed: int
    inputs: int = 0
    understood: Counter[str] = field(default_factory=Counter)
    malformed: Counter[str] = field(default_factory=Counter)
    """Inputs by kind."""
    seconds: float = 0.0
    slowest_s: float = 0.0
    """CPU time of the slowest decoding."""
    rss_mib: list[float] = field(default_factory=list)
    """Memory of this process after every tenth of the run."""

    @property
    def growth_mib(self) -> float:
        """How much memory has grown since a tenth was done: by then everything has been in use."""
        return self.rss_mib[-1] - self.rss_mib[0]

    def as_json(self) -> dict[str, object]:
        """For a file."""
        counts = {"understood": dict(self.understood), "malformed": dict(self.malformed)}
        figures = {"inputs": self.inputs, "seconds": self.seconds, "slowest_s": self.slowest_s}
        memory = {"rss_mib": self.rss_mib, "growth_mib": self.growth_mib}
        return {"seed": self.seed, **figures, **counts, **memory}


def fuzz_decoder(seed: int, inputs: int, progress: Callable[[int], None] = lambda _: None) -> Report:
    """Decode so many hostile messages; raises BrokenDecoderError."""
    report, began_s, tenth = Report(seed), time.perf_counter(), max(1, inputs // 10)
    for first in range(0, inputs, _ROUND):
        hostile = Hostile(Dice(seed, first))
        for k in range(first, min(first + _ROUND, inputs)):
            kind, frames = hostile.next()
            _count(report, f"--seed {seed}, input {k} ({kind})", kind, frames)
            if (k + 1) % tenth == 0:
                report.rss_mib.append(round(rss_mib(), 1))
                progress(k + 1)
    report.inputs, report.seconds = inputs, round(time.perf_counter() - began_s, 1)
    return report


def _count(report: Report, where: str, kind: str, frames: Frames) -> None:
    """Decode one input and note what came of it."""
    began_s = time.process_time()
    try:
        _decode(frames)
    except MalformedMessage as error:
        if len(str(error)) > _LONGEST_REASON or not str(error).isprintable():
            raise BrokenDecoderError(f"{where}: a reason that does not fit a log: {error!r:.200}") from None
        report.malformed[kind] += 1
    except Exception as error:
        raise BrokenDecoderError(f"{where}: {error!r:.200}; its frames: {_in_hex(frames)}") from error
    else:
        report.understood[kind] += 1
    report.slowest_s = max(report.slowest_s, time.process_time() - began_s)


def _decode(frames: Frames) -> None:
    """Decode; what was understood must survive the way there and back."""
    message = decode(frames)
    again = [bytes(part) for part in encode(message)]
    if [bytes(part) for part in encode(decode(again))] != again:
        raise AssertionError("what was understood is another message when it is sent on")


def _in_hex(frames: Frames) -> str:
    return " ".join(frame.hex()[:2000] or "-" for frame in frames)


def rss_mib(pid: int | None = None) -> float:
    """Memory in use by a process, else this one, in MiB; its peak where the system does not tell."""
    statm = Path(f"/proc/{pid or os.getpid()}/statm")
    if statm.exists():
        return int(statm.read_text().split()[1]) * resource.getpagesize() / 2**20
    if sys.platform == "darwin":
        command = ["/bin/ps", "-o", "rss=", "-p", str(pid or os.getpid())]
        return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout) / 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
