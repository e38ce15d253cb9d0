"""Services killed and held up at random moments of runs whose poses must be those of an undisturbed one."""

import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.table import Table

from bench.soak.dice import Dice
from bench.soak.fault_injector import FaultInjector, FaultPlan
from bench.soak.latency import Latency, Stopwatch
from bench.soak.stage import make_take
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.settings import PRESETS, SearchSettings
from services.mocap.take.folder import open_take
from services.runs.launcher import Launcher, free_endpoint
from services.runs.progress import Progress
from services.runs.track import TakeJob, track

_CAMERAS = 4
_WORKERS = 4
_BOTH_WAYS = SearchSettings(search_limbs="always")
"""Every frame has work for every worker, on the way back as well."""
_FORWARDS = PRESETS["plain"].model_copy(update={"detail_px": PRESETS["default"].detail_px})
"""Every frame has work for every worker, and is solved once, so that it can be timed."""
_ANYBODY = FaultPlan(
    most={"limb_worker": 12, "segmentation": 8, "recorder": 4, "coordinator": 4},
    longest_wait_s=2.0,
    hang_s=(0.1, 6.0),
)
"""Who dies too often in a run ends it."""
_WORKERS_ONLY = FaultPlan(
    most={"limb_worker": 12}, longest_wait_s=2.0, hang_s=(4.0, 6.0), first_frame=3, frames_between=3
)


@dataclass
class Report:
    """What came of it."""

    seed: int
    runs: int = 0
    frames: int = 0
    """Frames of all disturbed runs together."""
    faults: Counter[str] = field(default_factory=Counter)
    """Kills and hangs by the victim."""
    lost: int = 0
    altered: int = 0
    """Frames that are missing in the results, or differ from the undisturbed run's in any digit."""
    latencies: list[Latency] = field(default_factory=list)
    """Of frames that lost a worker, and nobody else."""
    seconds: float = 0.0

    def as_json(self) -> dict[str, object]:
        """For a file."""
        counts = {"runs": self.runs, "frames": self.frames, "lost": self.lost, "altered": self.altered}
        told = {"seconds": self.seconds, "latencies": [latency.as_json() for latency in self.latencies]}
        return {"seed": self.seed, "faults": dict(self.faults), **counts, **told}


@dataclass(frozen=True)
class _Outcome:
    rows: dict[str, str]
    """Lines of poses.csv by their frame."""
    stopwatch: Stopwatch


def kill_at_random(seed: int, kills: int, frames: int, progress: Callable[[int], None]) -> Report:
    """Inject so many faults, in as many runs over a take of so many frames as that takes.

    Then workers only are struck in one more run, forwards, for the time that this costs. Raises what `track`
    raises where a run fails altogether.
    """
    report, began_s = Report(seed), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="xormocap-soak-") as temporary:
        folder = Path(temporary)
        take = make_take(folder / "take", frames, _CAMERAS)
        quiet = _run(take, folder / "quiet", None, _BOTH_WAYS)
        while report.faults.total() < kills:
            before = report.faults.total()
            injector = FaultInjector(Dice(seed, report.runs), _ANYBODY, kills - before)
            injector.tell = partial(_tell_all, progress, before)
            _compare(report, quiet, _run(take, folder / f"run-{report.runs}", injector, _BOTH_WAYS))
            report.faults += injector.faults
        injector = FaultInjector(Dice(seed, report.runs), _WORKERS_ONLY, frames)
        quiet = _run(take, folder / "quiet-forwards", None, _FORWARDS)
        disturbed = _run(take, folder / "workers", injector, _FORWARDS)
        _compare(report, quiet, disturbed)
        report.faults += injector.faults
        report.latencies = _latencies(injector, quiet.stopwatch, disturbed.stopwatch)
    report.seconds = round(time.monotonic() - began_s, 1)
    return report


def _run(take: Path, out: Path, injector: FaultInjector | None, search: SearchSettings) -> _Outcome:
    """Track a take, disturbed or not."""
    endpoint, opened = free_endpoint(), open_take(take)
    with Stopwatch(endpoint) as stopwatch:

        def started(launcher: Launcher) -> None:
            if injector is not None:
                injector.begin(launcher, stopwatch)

        try:
            job = TakeJob(
                take=opened,
                out=out,
                frames=range(opened.settings.frames),
                workers=_WORKERS,
                overlay=False,
                engine=EngineSettings(threads=1),
                search=search,
                endpoint=endpoint,
            )
            track(job, show=_say_nothing, started=started)
        finally:
            if injector is not None:
                injector.end()
    lines = (out / "poses.csv").read_text().splitlines()[1:]
    return _Outcome({line.partition(",")[0]: line for line in lines}, stopwatch)


def _tell_all(progress: Callable[[int], None], before: int, done: int) -> None:
    progress(before + done)


def _say_nothing(_: Progress) -> None:
    """Progress of the kills is shown, not that of the runs."""


def _compare(report: Report, quiet: _Outcome, disturbed: _Outcome) -> None:
    """Count what differs."""
    report.runs += 1
    report.frames += len(disturbed.rows)
    report.lost += len(quiet.rows.keys() - disturbed.rows.keys())
    report.altered += sum(quiet.rows.get(frame) != row for frame, row in disturbed.rows.items())


def _latencies(injector: FaultInjector, quiet: Stopwatch, disturbed: Stopwatch) -> list[Latency]:
    """How much longer frames took in which a worker was struck."""
    found = []
    for fault in injector.struck:
        lap, usual = disturbed.laps.get(fault.frame), quiet.laps.get(fault.frame)
        if lap is not None and usual is not None:
            times_s = (lap.seconds - usual.seconds, lap.deadline_s, lap.limb_s)
            found.append(Latency(fault.way, fault.frame, *(round(seconds, 3) for seconds in times_s)))
    return found


def show_kills(report: Report, console: Console) -> None:
    """Print a report."""
    table = Table("fault", "times", box=None)
    for fault, times in sorted(report.faults.items()):
        table.add_row(fault, f"{times}")
    console.print(table)
    console.print(
        f"{report.faults.total()} faults in {report.runs} runs of {report.frames} frames together, "
        f"{report.seconds:.0f} s: {report.lost} frames lost, {report.altered} altered"
    )
    _show_latencies(report.latencies, console)


def _show_latencies(latencies: list[Latency], console: Console) -> None:
    """What losing a worker cost, beside what it may cost."""
    table = Table("frame", "its worker was", "took longer", "deadline", "one limb", "within both", box=None)
    for latency in sorted(latencies, key=lambda one: (one.way, one.frame)):
        seconds = (f"{s:.2f} s" for s in (latency.added_s, latency.deadline_s, latency.limb_s))
        table.add_row(f"{latency.frame}", latency.way, *seconds, "yes" if latency.is_within else "no")
    console.print(table)
    for way in ("killed", "held up"):
        found = [latency for latency in latencies if latency.way == way]
        if found:
            added_s, within = [one.added_s for one in found], sum(one.is_within for one in found)
            console.print(
                f"a worker {way}: its frame took {median(added_s):.2f} s longer (median), {max(added_s):.2f} "
                f"s at most; within the deadline and one limb's time in {within} of {len(found)}",
                soft_wrap=True,
            )
