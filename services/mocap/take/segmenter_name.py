"""What `--segmenter NAME` means: which names there are, whether videos are used, and which other files.

To add a segmenter, add a row to `KINDS`, and how it is made to services/segmentation/segmenters.py. The help
of `--segmenter` is made of the rows, and a test holds the table of services/segmentation/README.md to them.
"""

import re
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from services.mocap.errors import UserError, nearest

AUTO = "auto"
READY = "silhouettes"
USUAL = "clean-plate"
GROUP = "xormocap.segmenters"
"""Entry points of other packages' segmenters."""
_NETWORK = "onnx"


class Kind(NamedTuple):
    """A row of the table: what a segmenter does, and what it needs."""

    meaning: str
    argument: str = ""
    """What may stand after the colon of `NAME:ARGUMENT`, in a word; "" for nothing."""
    needs_argument: bool = False
    pattern: str = ".+"
    """What a whole argument matches."""
    hint: str = ""
    """What an error adds to that word."""
    needs_plate: bool = False
    """Whether it needs the empty scene."""

    def spellings(self, name: str) -> list[str]:
        """How an option may name it."""
        with_argument = [f"{name}:{self.argument}"] if self.argument else []
        return with_argument if self.needs_argument else [name, *with_argument]


KINDS: dict[str, Kind] = {
    USUAL: Kind("compares with the empty stage, in all cameras together", needs_plate=True),
    "paper": Kind(
        "the paper's test, as a baseline: colour statistics of each camera, and how far shadow changes a "
        "colour",
        needs_plate=True,
    ),
    "mog2": Kind(
        "OpenCV's Gaussian mixtures with a shadow test, trained on the empty stage", needs_plate=True
    ),
    "bgsegm": Kind("Gaussian mixtures as well, without a shadow test", needs_plate=True),
    "chroma": Kind(
        "a green or blue screen; its colour is given, or found along the edges of the pictures",
        "RRGGBB",
        pattern="[0-9a-fA-F]{6}",
        hint=" in hexadecimal, such as chroma:00b140",
    ),
    _NETWORK: Kind("your own matting network", "FILE", needs_argument=True),
}


def meanings() -> dict[tuple[str, ...], str]:
    """What the names mean, plug-ins left out, by the spellings of each."""
    return {
        (AUTO,): f"{READY} if the take has some, else {USUAL}",
        **{tuple(kind.spellings(name)): kind.meaning for name, kind in KINDS.items()},
        (READY,): "the silhouettes in the take",
    }


def known_segmenters() -> list[str]:
    """The names for --segmenter on this machine, installed plug-ins last."""
    return [AUTO, READY, *KINDS, *sorted(entry_points(group=GROUP).names)]


def kind_of(name: str) -> Kind:
    """The row of a segmenter, with its argument or without; a plug-in's needs nothing."""
    return KINDS.get(name.partition(":")[0], Kind(""))


def check_segmenter(name: str) -> None:
    """Raise UserError for an invalid --segmenter."""
    kind, colon, argument = name.partition(":")
    if kind not in known_segmenters():
        raise UserError(
            f"--segmenter {name}: there is no such segmenter: {nearest(kind, known_segmenters())}"
        )
    row = kind_of(kind)
    if colon and not row.argument:
        raise UserError(f"--segmenter {name}: {kind} takes nothing after its name: leave out :{argument}")
    if (colon or row.needs_argument) and not re.fullmatch(row.pattern, argument):
        raise UserError(f"--segmenter {name}: expected {kind}:{row.argument}{row.hint}")


def looks_at_videos(name: str, has_silhouettes: bool) -> bool:
    """Whether a segmenter makes silhouettes from videos, for a take with or without its own."""
    return name not in (AUTO, READY) or not has_silhouettes


def files_of_segmenter(name: str) -> list[Path]:
    """The files outside the take and xormocap that determine a segmenter's silhouettes.

    These are the network of onnx:FILE, or the files of a plug-in's package, which is located but not
    imported. Empty if the file or plug-in is not on this machine.
    """
    kind, _, argument = name.partition(":")
    if kind == _NETWORK:
        return [path for path in [Path(argument)] if path.is_file()]
    files: set[Path] = set()
    for entry in entry_points(group=GROUP, name=kind):
        spec = find_spec(entry.module.partition(".")[0])
        if spec is not None and spec.submodule_search_locations:
            folders = [Path(folder) for folder in spec.submodule_search_locations]
            files.update(path for folder in folders for path in folder.rglob("*") if path.is_file())
        elif spec is not None and spec.origin is not None:
            files.add(Path(spec.origin))
    return sorted(path for path in files if path.suffix != ".pyc")
