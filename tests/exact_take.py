"""A synthetic take with exact silhouettes in place of videos, whose background takes seconds to learn."""

import shutil
from pathlib import Path
from typing import Any

from services.mocap.synth.take import write_synthetic_take
from services.mocap.take import layout


def write_exact_take(folder: Path, **options: Any) -> None:
    """Write a take as write_synthetic_take does, without its videos and clean plates."""
    write_synthetic_take(folder, **options)
    in_place_of_videos(folder)


def in_place_of_videos(folder: Path) -> None:
    """Put a synthetic take's exact silhouettes in place of its videos and clean plates."""
    for name in (layout.VIDEOS, layout.BACKGROUND):
        shutil.rmtree(folder / name, ignore_errors=True)
    (folder / "reference" / layout.SILHOUETTES).rename(folder / layout.SILHOUETTES)
