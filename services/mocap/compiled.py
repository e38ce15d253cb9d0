"""Where Numba keeps compiled code: a folder of its own for every state of the sources.

Numba compiles a function again when the file that defines it has changed, but not when a function or a table
that it takes from another file has. After an update it would go on with old code, so the sources name the
folder.
"""

import hashlib
import os
import shutil
from pathlib import Path

_SOURCES = Path(__file__).parent
_COMPILED = ("body", "energy", "fit", "search", "synth", "../segmentation")
"""Packages with compiled code in them, and with the tables that it takes in as constants."""
_KEPT = _SOURCES / "__pycache__"


def compiled_folder() -> Path:
    """The folder for the sources as they are now."""
    digest = hashlib.sha256()
    for package in _COMPILED:
        for path in sorted((_SOURCES / package).rglob("*.py")):
            name = path.relative_to(_SOURCES / package).as_posix()
            digest.update(f"{package}/{name}\0{path.stat().st_size}\0".encode())
            digest.update(path.read_bytes())
    return _KEPT / f"compiled-{digest.hexdigest()[:16]}"


def keep_compiled_code() -> None:
    """Tell Numba, before it is imported, where to keep compiled code; whoever said so before is right."""
    os.environ.setdefault("NUMBA_CACHE_DIR", str(compiled_folder()))


def forget_other_code() -> None:
    """Remove what was compiled from other states of the sources."""
    for folder in _KEPT.glob("compiled-*"):
        if folder != compiled_folder():
            shutil.rmtree(folder, ignore_errors=True)
