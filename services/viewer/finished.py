"""Finished results, as the page shows them."""

import numpy as np

from services.mocap.result.result import Result
from services.viewer.frame_history import FrameHistory
from services.viewer.solved_frame import ON_PAGE, SolvedFrame


def history_of(result: Result) -> FrameHistory:
    """All frames of results, as they were tracked.

    Raises TakeError if the energies or the stages' times cannot be read.
    """
    tracked, known = result.tracked, result.quantities
    frames = range(int(result.frames[0]), int(result.frames[-1]) + 1)
    unknown = np.full(len(frames), np.nan)
    columns = [known.get(row.name, {}).get(label, unknown) for row in ON_PAGE for label in row.labels]
    numbers = np.column_stack(columns).astype(np.float64)
    iou = list(known.get("iou", {}).values())
    iou_of_frames = np.array(iou, np.float64).reshape(len(iou), len(frames)).T
    history = FrameHistory(frames)
    for row, frame in enumerate(frames):
        history.put(
            SolvedFrame(
                frame=frame,
                time_s=float(tracked.times_s[row]),
                pose=tracked.poses[row],
                numbers=numbers[row],
                iou=iou_of_frames[row],
            )
        )
    history.is_over = True
    return history
