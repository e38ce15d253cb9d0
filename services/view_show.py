"""Finished results as a show for the page."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from services.mocap.body.actor import build_body
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.errors import UserError
from services.mocap.take.actor_file import read_actor
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import ACTOR
from services.mocap.take.marks import PARTS
from services.mocap.take.tables import PoseTable, read_poses_csv
from services.mocap.types import Mask
from services.recorder.result_folder import POSES, RUN_JSON
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.source import Segmenter, make_segmenter
from services.viewer.pictures import TakePictures
from services.viewer.reel import STAGES, Reel, Shot
from services.viewer.show import Show
from services.viewer.tiles import TileArtist


def finished_show(result: Path, take: Path | None) -> Show:
    """What a folder of results has to show, and its take, where that is still to be found.

    take: the take's folder; None: where run.json says. Raises UserError where the results cannot be used.
    """
    if not (result / POSES).exists():
        raise UserError(f"{result}: holds no {POSES}: expected the folder that xormocap track --out wrote")
    table, body = read_poses_csv(result / POSES), build_body(read_actor(result / ACTOR))
    opened, remark = _take_of(result, take)
    reel = _reel(table)
    if opened is None:
        fps = _fps(table)
        return Show(result.name, fps, reel, body, None, (), None, is_live=False, remark=remark)
    rig = Rig.of(opened.cameras)
    artist = TileArtist(body, rig, TakePictures(opened, _segmentation(opened)))
    names = tuple(camera.name for camera in opened.cameras)
    settings = opened.settings
    return Show(settings.name, settings.fps, reel, body, rig, names, artist, is_live=False)


def _reel(table: PoseTable) -> Reel:
    frames = range(int(table.frames[0]), int(table.frames[-1]) + 1)
    reel = Reel(frames, capacity=len(frames))
    n, unknown = len(table.frames), np.full(len(STAGES), np.nan)
    marks = table.marks
    confidence = np.full((n, len(PARTS)), np.nan) if marks is None else marks.confidence
    distrusted: Mask = np.zeros((n, len(PARTS)), bool) if marks is None else marks.distrusted
    for row, (frame, time_s, energy_px) in enumerate(
        zip(table.frames.tolist(), table.times_s.tolist(), table.energies_px.tolist(), strict=True)
    ):
        reel.put(Shot(frame, time_s, table.poses[row], energy_px, confidence[row], distrusted[row], unknown))
    reel.is_over = True
    return reel


def _fps(table: PoseTable) -> float:
    """From the times; results of a single frame have none."""
    span_s = float(table.times_s[-1] - table.times_s[0])
    return (int(table.frames[-1]) - int(table.frames[0])) / span_s if span_s > 0 else 25.0


def _take_of(result: Path, take: Path | None) -> tuple[Take | None, str]:
    """The take that results were made from, or why it is not there."""
    if take is not None:
        return open_take(take), ""
    try:
        folder = Path(json.loads((result / RUN_JSON).read_text(encoding="utf-8"))["take"]["folder"])
    except (OSError, ValueError, LookupError, TypeError):
        return None, f"{result / RUN_JSON} does not say where the take is: give --take to see its cameras."
    if not folder.is_dir():
        return None, f"The take is not at {folder} any more: give --take to see its cameras."
    return open_take(folder), ""


def _segmentation(take: Take) -> Callable[[Camera, int, int], Iterator[Mask]]:
    """Silhouettes as the tracker had them; a camera's clean plate is learnt when it is first asked for."""
    learnt: dict[str, Segmenter] = {}

    def silhouettes(camera: Camera, start: int, stop: int) -> Iterator[Mask]:
        if camera.name not in learnt:
            learnt[camera.name] = make_segmenter(take, camera, SegmentationSettings())
        return learnt[camera.name].silhouettes(start, stop)

    return silhouettes
