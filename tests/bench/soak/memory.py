"""What memory the services take over a long take: one short motion, to and fro, again and again."""

import os
import shutil
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bench.soak.fuzz import rss_mib
from bench.soak.stage import make_take
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import open_take
from services.mocap.take.layout import SETTINGS, silhouette_folder, silhouette_path
from services.mocap.take.settings import write_settings
from services.runs.launcher import SERVICES, Launcher
from services.runs.progress import Progress
from services.runs.track import TakeJob, track
from services.segmentation.files import write_silhouettes

_MOTION_FRAMES = 30
_CAMERAS = 4
_WORKERS = 2
_EVERY_S = 1.0
MOST_GROWTH_MIB = 24.0
"""From a tenth of the take to its end; a tenth of a pose's size per frame would already be more."""


@dataclass
class Report:
    """What was seen."""

    frames: int
    seconds: float = 0.0
    seen_mib: dict[str, list[tuple[int, float]]] = field(default_factory=lambda: defaultdict(list))
    """By service: frames done by then, and its memory; of several processes the largest."""

    def at(self, name: str, share: float) -> float:
        """A service's memory when that share of the frames was done."""
        after = [mib for frames, mib in self.seen_mib[name] if frames >= share * self.frames]
        return after[0] if after else self.seen_mib[name][-1][1]

    def growth_mib(self, name: str) -> float:
        """From a tenth, by when everything has been in use, to the end of the tracking."""
        return self.at(name, 1.0) - self.at(name, 0.1)

    def as_json(self) -> dict[str, object]:
        """For a file."""
        growth = {name: round(self.growth_mib(name), 1) for name in self.seen_mib}
        seen = {name: points[:: max(1, len(points) // 200)] for name, points in self.seen_mib.items()}
        return {"frames": self.frames, "seconds": self.seconds, "growth_mib": growth, "seen_mib": seen}


def watch_memory(frames: int, progress: Callable[[int], None]) -> Report:
    """Track so many frames; raises what `track` raises."""
    report, began_s = Report(frames), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="xormocap-soak-") as temporary:
        opened = open_take(_long_take(Path(temporary), frames))
        launchers: list[Launcher] = []
        looked_s = 0.0

        def show(run: Progress) -> None:
            nonlocal looked_s
            if run.stage != "writing results" and time.monotonic() - looked_s > _EVERY_S:
                looked_s = time.monotonic()
                _look(launchers[0], run.frames_done, report)
                progress(run.frames_done)

        job = TakeJob(
            take=opened,
            out=Path(temporary) / "out",
            frames=range(frames),
            workers=_WORKERS,
            overlay=False,
            engine=EngineSettings(threads=1),
            search=SearchSettings(),
        )
        track(job, show=show, started=launchers.append)
    report.seconds = round(time.monotonic() - began_s, 1)
    return report


def _look(launcher: Launcher, frames_done: int, report: Report) -> None:
    for name in SERVICES:
        with suppress(OSError, ValueError):  # it may just have ended, or is not part of this run
            largest_mib = max(rss_mib(pid) for pid in launcher.pids(name))
            report.seen_mib[name].append((frames_done, largest_mib))


def _long_take(folder: Path, frames: int) -> Path:
    """A take whose silhouettes are those of a short one, to and fro, under as many names."""
    short, long = make_take(folder / "short", _MOTION_FRAMES, _CAMERAS), folder / "long"
    opened = open_take(short)
    write_silhouettes(opened, folder / "drawn", lambda: None)
    shutil.copytree(short, long, ignore=shutil.ignore_patterns("videos", "background", "reference", SETTINGS))
    to_and_fro = [*range(_MOTION_FRAMES), *range(_MOTION_FRAMES - 2, 0, -1)]
    for camera in opened.cameras:
        target = silhouette_folder(long, camera.name)
        target.mkdir(parents=True)
        for frame in range(frames):
            source = silhouette_path(
                silhouette_folder(folder / "drawn", camera.name), to_and_fro[frame % len(to_and_fro)]
            )
            os.link(source, silhouette_path(target, frame))
    write_settings(long / SETTINGS, opened.settings.model_copy(update={"frames": frames}))
    return long


def show_memory(report: Report, console: Console) -> None:
    """Print a report."""
    shares = (0.1, 0.25, 0.5, 0.75, 1.0)
    table = Table("MiB after", *(f"{share:.0%}" for share in shares), "growth", box=None)
    for name in report.seen_mib:
        values = [f"{report.at(name, share):.1f}" for share in shares]
        table.add_row(name, *values, f"{report.growth_mib(name):+.1f}")
    console.print(table)
    console.print(f"{report.frames} frames in {report.seconds:.0f} s")
