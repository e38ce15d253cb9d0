"""Finished results as a show for the page."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

from services.mocap.camera.rig import Rig
from services.mocap.result.layout import RUN_JSON
from services.mocap.result.result import Result, load_result
from services.mocap.take.folder import Take, open_take
from services.mocap.types import Trimap
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import Segmenter
from services.viewer.finished import FinishedFrames
from services.viewer.frame_history import FrameHistory
from services.viewer.pictures import TakePictures
from services.viewer.show import Show
from services.viewer.tiles import TileArtist


def finished_show(folder: Path, take: Path | None) -> Show:
    """What a folder of results has to show, as it was tracked, and its take, where that is still to be found.

    take: the take's folder; None: where run.json says. Raises UserError where the results cannot be used.
    """
    result = load_result(folder)
    opened, remark = _take_of(result, take)
    name, fps, history, body = result.motion.name, result.fps, _history(result), result.motion.body
    if opened is None:
        return Show(name, fps, history, body, None, (), None, is_live=False, remark=remark)
    rig = Rig.of(opened.cameras)
    artist = TileArtist(body, rig, TakePictures(opened, _segmentation(opened)))
    names = tuple(camera.name for camera in opened.cameras)
    return Show(name, fps, history, body, rig, names, artist, is_live=False)


def _history(result: Result) -> FrameHistory:
    finished = FinishedFrames(result)
    history = FrameHistory(finished.frames, capacity=len(finished.frames))
    for solved in map(finished.solved, finished.frames):
        if solved is not None:
            history.put(solved)
    history.is_over = True
    return history


def _take_of(result: Result, take: Path | None) -> tuple[Take | None, str]:
    """The take that results were made from, or why it is not there."""
    folder = take or result.take_folder
    if folder is None:
        where = result.folder / RUN_JSON
        return None, f"{where} does not say where the take is: give --take to see its cameras."
    if take is None and not folder.is_dir():
        return None, f"The take is not at {folder} any more: give --take to see its cameras."
    return open_take(folder), ""


def _segmentation(take: Take) -> Callable[[int, int], Iterator[list[Trimap]]]:
    """Silhouettes as the tracker had them; clean plates are learnt when any are first asked for."""

    @cache
    def segmenter() -> Segmenter:
        return make_segmenter(take, take.cameras, SegmentationSettings())

    return lambda start, stop: segmenter().trimaps(start, stop)
