"""Frames of finished results, as the page shows them."""

import logging
from pathlib import Path

import numpy as np

from services.mocap.errors import UserError
from services.mocap.result.layout import RUN_JSON
from services.mocap.result.result import Result, load_result
from services.viewer.solved_frame import ON_PAGE, SolvedFrame

log = logging.getLogger(__name__)


class FinishedFrames:
    """Results, frame by frame, as they were tracked."""

    def __init__(self, result: Result) -> None:
        """Raises TakeError if the energies or the stages' times cannot be read."""
        self._tracked, known = result.tracked, result.quantities
        self.frames = range(int(result.frames[0]), int(result.frames[-1]) + 1)
        unknown = np.full(len(self.frames), np.nan)
        columns = [known.get(row.name, {}).get(label, unknown) for row in ON_PAGE for label in row.labels]
        self._numbers = np.column_stack(columns).astype(np.float64)
        iou = list(known.get("iou", {}).values())
        self._iou = np.array(iou, np.float64).reshape(len(iou), len(self.frames)).T
        """(N, C)"""

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame; None for one that was not tracked."""
        if frame not in self.frames:
            return None
        row = frame - self.frames.start
        return SolvedFrame(
            frame=frame,
            time_s=float(self._tracked.times_s[row]),
            pose=self._tracked.poses[row],
            numbers=self._numbers[row],
            iou=self._iou[row],
        )


class FinishedTake:
    """The results of a take that has just been tracked, once they are written."""

    def __init__(self, folder: Path | None, take: str) -> None:
        """folder: where they will be; None: unknown."""
        self._folder, self._take = folder, take
        self._frames: FinishedFrames | None = None
        self._read_ns = 0
        """Modification time of the results that were last read."""

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame; None while there are no results, or if they belong to another take."""
        if self._frames is None and self._folder is not None:
            try:
                written_ns = (self._folder / RUN_JSON).stat().st_mtime_ns
                if written_ns != self._read_ns:
                    self._read_ns = written_ns
                    result = load_result(self._folder)
                    if result.motion.name == self._take:
                        self._frames = FinishedFrames(result)
            except FileNotFoundError:
                pass  # not written yet
            except UserError as error:
                log.warning("%s", error)
        return None if self._frames is None else self._frames.solved(frame)
