"""What `--segmenter NAME` means for a take: whether its videos are used, and which other files."""

from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

AUTO = "auto"
READY = "silhouettes"
GROUP = "xormocap.segmenters"
"""Entry points of other packages' segmenters."""
_NETWORK = "onnx"


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
