"""`xormocap segment`: writes the silhouettes of a take as files."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from services.commands.consoles import TakeFolder, say, stderr, warn
from services.mocap.take.folder import open_take
from services.mocap.take.layout import SILHOUETTES
from services.options import DEFAULT_SEGMENTER, SegmenterOption
from services.runs.reporting import kept_warnings
from services.segmentation.files import write_silhouettes


def segment(
    take: TakeFolder,
    out: Annotated[Path, typer.Option(help="Folder for the silhouettes.")],
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
) -> None:
    """Write the silhouettes of a take's videos, not undistorted, so that they can replace the videos in a
    take."""
    opened = open_take(take)
    warn(opened.remarks)
    with kept_warnings() as warnings, Progress(console=stderr) as bar:
        task = bar.add_task("segmenting", total=opened.settings.frames * len(opened.cameras))
        write_silhouettes(opened, out, lambda: bar.advance(task), segmenter)
    warn(warnings)
    what = f"{opened.settings.frames} frames of {len(opened.cameras)} cameras"
    say(f"{out}/{SILHOUETTES}/<camera>/000000.png: {what}")
