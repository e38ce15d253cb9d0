"""The folder for Numba's compiled code: one for every version of the sources.

Numba compiles a function again when the file that defines it has changed, but not when a function or a table
that it takes from another file has. After an update it would continue with old code, so the folder's name is
a hash of the sources.
"""

import hashlib
import os
import shutil
from pathlib import Path

_SOURCES = Path(__file__).parent
_COMPILED = ("body", "energy", "fit", "search", "synth", "../segmentation")
"""Packages with compiled code, and with tables that become constants in it; the modules beside this one tell
how it is compiled."""
_KEPT = _SOURCES / "__pycache__"


def compiled_folder() -> Path:
    """The folder for the present sources."""
    digest = hashlib.sha256()
    sources = [("", _SOURCES.glob("*.py"))]
    sources += [(package, (_SOURCES / package).rglob("*.py")) for package in _COMPILED]
    for package, paths in sources:
        for path in sorted(paths):
            name = path.relative_to(_SOURCES / package).as_posix()
            digest.update(f"{package}/{name}\0{path.stat().st_size}\0".encode())
            digest.update(path.read_bytes())
    return _KEPT / f"compiled-{digest.hexdigest()[:16]}"


def keep_compiled_code() -> None:
    """Set Numba's cache folder before Numba is imported, unless it is set already."""
    os.environ.setdefault("NUMBA_CACHE_DIR", str(compiled_folder()))


def forget_other_code() -> None:
    """Remove code compiled from other versions of the sources."""
    for folder in _KEPT.glob("compiled-*"):
        if folder != compiled_folder():
            shutil.rmtree(folder, ignore_errors=True)
