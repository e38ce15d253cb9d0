"""What the page is told, in the fields of messages; numbers that are not known are null."""

from typing import Any

import numpy as np

from services.mocap.body.colours import parts_of_classes
from services.mocap.export.tiles import BEYOND_BGR, CLASSES_BGR, MISSED_BGR
from services.mocap.result.words import ENERGY_IN_WORDS, IOU_IN_WORDS
from services.mocap.take.marks import PARTS, judged_parts
from services.mocap.take.quantities import STAGES
from services.mocap.verdict.verdict import frame_in_words, part_in_words
from services.viewer.charts import Drawn
from services.viewer.controls import Controls, Player
from services.viewer.frame_history import MOST_FRAMES, FrameHistory
from services.viewer.scene import DISTRUSTED_RGB, rgb_of
from services.viewer.show import Show
from services.viewer.solved_frame import SolvedFrame

Message = tuple[list[bytes], dict[str, Any]]
"""Blobs and fields."""


def show_words(show: Show, charts: tuple[str, ...], controls: Controls) -> dict[str, Any]:
    """A take, and what a user can choose."""
    verdict, look = show.verdict, controls.look
    classes = parts_of_classes(show.body.colour_classes)
    return {
        "take": show.take,
        "fps": show.fps,
        "is_live": show.is_live,
        "remark": show.remark,
        "cameras": list(show.camera_names),
        "has_tiles": show.artist is not None,
        "contents": ["pictures"] * show.has_pictures
        + ["silhouettes", "difference"]
        + ["colours"] * bool(classes),
        "content": look.content,
        "parts": [{"name": part, "words": part_in_words(part)} for part in PARTS],
        "charts": list(charts),
        "chosen": list(controls.charts),
        "legend": [
            (rgb_of("left_hand"), "left"),
            (rgb_of("right_hand"), "right"),
            (DISTRUSTED_RGB, "doubtful"),
        ],
        "legends": {
            "difference": [
                (MISSED_BGR[::-1], "actor without model"),
                (BEYOND_BGR[::-1], "model without actor"),
            ],
            "colours": [(CLASSES_BGR[k - 1][::-1], words) for k, words in classes.items()],
        },
        "words": {"energy": ENERGY_IN_WORDS, "iou": IOU_IN_WORDS},
        "verdict": None
        if verdict is None
        else {
            "level": verdict.level,
            "headline": verdict.headline,
            "doubts": verdict.doubts_in_words,
            "causes": [str(cause) for cause in verdict.causes],
        },
    }


def frame_words(solved: SolvedFrame, player: Player, behind_s: float | None) -> dict[str, Any]:
    """The shown frame."""
    frames, extent = player.history.frames, player.history.extent
    seconds = float(solved.of("seconds")[STAGES.index("frame")])
    is_judged = judged_parts(solved.of("confidence"), solved.distrusted).any()
    return {
        "frame": solved.frame,
        "last": extent[-1] if extent == frames else None,  # None: nobody knows how many will come
        "time_s": solved.time_s,
        "state": "live" if player.is_live else "playing" if player.is_playing else "standing",
        "energy_px": solved.energy_px if np.isfinite(solved.energy_px) else None,
        "verdict": frame_in_words(solved.distrusted.tolist()) if is_judged else None,
        "distrusted": solved.distrusted.tolist(),
        "frames_per_s": 1 / seconds if np.isfinite(seconds) and seconds > 0 else None,
        "behind_s": behind_s,
    }


def why_missing(frame: int, history: FrameHistory) -> str:
    """A sentence about a frame that is not known."""
    if history.newest is None or frame > history.newest:
        return f"Frame {frame} is not known yet."
    if frame < history.frames.start:
        return f"Frame {frame} is no longer in memory: the page keeps at most {MOST_FRAMES} frames."
    return (
        f"Frame {frame} has not come: the coordinator keeps few frames; others come from the recorder's "
        "journal, if the viewer knows the results folder (--results)."
    )


def timeline_message(history: FrameHistory) -> Message:
    """The whole take in B bins: known (B), doubtful, unjudged (B, 6) as bytes, the energy (B) as float32."""
    overview, extent = history.overview(), history.extent
    flags = (overview.known, overview.doubtful, overview.unjudged)
    blobs = [*(of.astype(np.uint8).tobytes() for of in flags), overview.energy_px.astype("<f4").tobytes()]
    return blobs, {"first": extent.start, "frames": len(extent)}


def chart_message(drawn: Drawn) -> Message:
    """Frames (N) as int32, doubtful (N) as bytes, and a blob of float32 (N) for each curve."""
    curves = [column.astype("<f4").tobytes() for column in drawn.values.T]
    blobs = [drawn.frames.astype("<i4").tobytes(), drawn.doubtful.astype(np.uint8).tobytes(), *curves]
    most = float(drawn.chart.most)
    return blobs, {
        "title": drawn.chart.title,
        "names": list(drawn.chart.names),
        "most": most if np.isfinite(most) else None,
    }
