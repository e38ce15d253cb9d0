"""Frames of finished results, as the page shows them."""

import contextlib
import logging
from pathlib import Path

import numpy as np

from services.mocap.errors import UserError
from services.mocap.result.energies import read_energies_csv
from services.mocap.result.layout import ENERGIES, RUN_JSON, TIMINGS
from services.mocap.result.result import Result, load_result
from services.mocap.result.timings import read_timings_csv
from services.mocap.take.marks import PARTS
from services.mocap.types import Floats
from services.viewer.frame_history import STAGES, SolvedFrame

log = logging.getLogger(__name__)


class FinishedFrames:
    """Results, frame by frame, as they were tracked."""

    def __init__(self, result: Result) -> None:
        """Raises TakeError where energies or the stages' times cannot be read."""
        self._result, timings = result, result.folder / TIMINGS
        self.frames = range(int(result.frames[0]), int(result.frames[-1]) + 1)
        seconds_of = read_timings_csv(timings) if timings.exists() else {}
        unknown = np.full(len(self.frames), np.nan)
        self._part_px = _part_px(result)
        self._seconds = np.column_stack([seconds_of.get(stage, unknown) for stage in STAGES])

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame; None for one that was not tracked."""
        if frame not in self.frames:
            return None
        row, tracked = frame - self.frames.start, self._result.tracked
        return SolvedFrame(
            frame=frame,
            time_s=float(tracked.times_s[row]),
            pose=tracked.poses[row],
            energy_px=float(tracked.energies_px[row]),
            confidence=self._result.confidence[row],
            distrusted=self._result.distrusted[row],
            part_px=self._part_px[row],
            seconds=self._seconds[row],
        )


def _part_px(result: Result) -> Floats:
    """(N, 6) the energy of each part; NaN where it was not written."""
    path = result.folder / ENERGIES
    known = read_energies_csv(path) if path.exists() else None
    if known is None or not np.array_equal(known.frames, result.frames):
        return np.full((len(result.frames), len(PARTS)), np.nan)
    return known.part_px


class FinishedTake:
    """The results of a take that has just been tracked, once they are there."""

    def __init__(self, folder: Path | None, take: str) -> None:
        """folder: where they will be; None: nobody knows."""
        self._folder, self._take = folder, take
        self._frames: FinishedFrames | None = None
        self._read_ns = 0
        """When those were written that were looked at last."""

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame; None as long as there are no results, or if they are another take's."""
        if self._frames is None and self._folder is not None:
            with contextlib.suppress(FileNotFoundError):
                written_ns = (self._folder / RUN_JSON).stat().st_mtime_ns
                if written_ns != self._read_ns:
                    self._read_ns = written_ns
                    self._read(self._folder)
        return None if self._frames is None else self._frames.solved(frame)

    def _read(self, folder: Path) -> None:
        try:
            result = load_result(folder)
            if result.motion.name == self._take:
                self._frames = FinishedFrames(result)
        except UserError as error:
            log.warning("%s", error)
