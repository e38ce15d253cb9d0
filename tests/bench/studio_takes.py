"""Takes of other bodies than ours: those that a studio's make_take.py makes, and their exact silhouettes.

The studio is an external tool, whose folder a person names. What it makes has the truth in TAKE/reference:
joints.csv, actor.json and, where they were asked for, silhouettes.
"""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from services.mocap.errors import TakeError, UserError
from services.mocap.take import layout

TRUE_SILHOUETTES = Path("reference") / layout.SILHOUETTES
_MAKER = "make_take.py"
_SILHOUETTES_ONLY = ("--fast", "--boundary-noise", "0.7")
"""Silhouettes without videos, whose edges are as uneven as those of a good segmentation."""
_WITH_VIDEOS = ("--silhouettes",)
"""Videos and clean plates, with the exact silhouettes beside them."""
_NAME = re.compile(r"([a-z]+)-(\d+)")
_FROM_VIDEOS = ("videos", "background", layout.SILHOUETTES)


@dataclass(frozen=True)
class TrueActor:
    """What is known of somebody."""

    height_m: float
    """Barefoot."""
    bone_lengths_m: dict[str, float]
    clothes: str
    """In one word, such as tight."""


@dataclass(frozen=True)
class Studio:
    """What makes takes, and where they are kept."""

    folder: Path
    kept: Path
    with_videos: bool
    """Otherwise it makes silhouettes alone."""

    def take(self, name: str) -> Path:
        """The folder of a take, made if it is not there yet. Raises UserError where that fails."""
        folder, part, maker = self.kept / name, self.kept / f"{name}.part", self.folder / _MAKER
        if folder.is_dir():
            return folder
        if not maker.is_file():
            raise UserError(f"--studio {self.folder}: has no {_MAKER}")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        options = _WITH_VIDEOS if self.with_videos else _SILHOUETTES_ONLY
        words = [str(word) for word in (sys.executable, maker, name, part, part / "reference", *options)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = done.stderr.strip().splitlines()
            raise UserError(f"{_MAKER} {name}: {said[-1] if said else f'ended with code {done.returncode}'}")
        part.rename(folder)
        return folder


def names_between(text: str) -> list[str]:
    """The takes from dev-100 to dev-124 of dev-100:dev-124, both included; one of dev-100, none of nothing.

    Raises UserError for other texts.
    """
    first, _, last = text.partition(":")
    if not text:
        return []
    start, end = _NAME.fullmatch(first), _NAME.fullmatch(last or first)
    if start is None or end is None or start[1] != end[1] or int(start[2]) > int(end[2]):
        raise UserError(f"{text}: expected a first and a last take, such as dev-100:dev-124")
    return [f"{start[1]}-{number:0{len(start[2])}d}" for number in range(int(start[2]), int(end[2]) + 1)]


def with_true_silhouettes(take: Path, made: Path) -> Path:
    """A folder of links to a take, with its exact silhouettes; the take itself where it has none."""
    if not (take / TRUE_SILHOUETTES).is_dir():
        return take
    made.mkdir(parents=True)
    for path in take.iterdir():
        if path.name not in _FROM_VIDEOS:
            (made / path.name).symlink_to(path.resolve())
    (made / layout.SILHOUETTES).symlink_to((take / TRUE_SILHOUETTES).resolve())
    return made


def true_actor(take: Path) -> TrueActor:
    """reference/actor.json of a take; raises TakeError where it lacks something."""
    path = take / "reference" / "actor.json"
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        lengths_m = {str(name): float(length) for name, length in told["bone_lengths"].items()}
        return TrueActor(float(told["stature"]), lengths_m, str(told["options"]["outfit"]["kind"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise TakeError(
            f"{path}: expected stature, bone_lengths and options.outfit.kind: {error!r}"
        ) from None
