"""Thinned levels kept on disk, so that a body is thinned once and not by every process of every run."""

import hashlib
import logging
import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from services.mocap.atomic import atomic_file
from services.mocap.body.actor import Body
from services.mocap.body.surface import Level
from services.mocap.energy.detail.thinning import ERRORS_M, thinned_levels
from services.mocap.errors import UserError
from services.mocap.side_by_side import N_CORES

log = logging.getLogger(__name__)

_FORMAT = 1
"""Raise it whenever meshes are thinned in another way."""
_MOST_BODIES = 64
"""Those used last are kept, at about 300 KB each."""


def cache_folder() -> Path:
    """Where bodies are kept: $XORMOCAP_CACHE, or xormocap in the user's folder for caches."""
    usual = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "xormocap"
    try:
        return Path(os.environ.get("XORMOCAP_CACHE") or usual).expanduser()
    except RuntimeError:  # a user without a home
        return Path(tempfile.gettempdir()) / f"xormocap-{os.getuid()}"


def levels_of(body: Body) -> list[list[Level]]:
    """Every surface's thinned levels, fine to coarse: read from disk, or made (about a second) and kept."""
    path = cache_folder() / f"levels-{_content_hash(body)}.npz"
    with suppress(OSError, EOFError, ValueError, LookupError, BadZipFile):  # not there, or not whole
        levels = _read(path, len(body.surfaces))
        with suppress(OSError):  # others may own it
            path.touch()
        return levels
    with ThreadPoolExecutor(N_CORES) as pool:  # one of its own: callers may be threads of side_by_side
        levels = list(pool.map(thinned_levels, *zip(*body.surfaces, strict=True)))
    try:
        _write(path, levels)
    except (OSError, UserError) as error:
        log.info("thinned meshes are not kept: %s", error)
    return levels


def _content_hash(body: Body) -> str:
    digest = hashlib.sha256(repr((_FORMAT, ERRORS_M)).encode())
    for vertices_m, faces in body.surfaces:
        digest.update(repr((vertices_m.shape, faces.shape)).encode())
        digest.update(np.ascontiguousarray(vertices_m).tobytes())
        digest.update(np.ascontiguousarray(faces).tobytes())
    return digest.hexdigest()


def _read(path: Path, n_surfaces: int) -> list[list[Level]]:
    with np.load(path) as arrays:
        table, vertices_m, faces = arrays["table"], arrays["vertices_m"], arrays["faces"]
    ladders: list[list[Level]] = [[] for _ in range(n_surfaces)]
    vertex = face = 0
    for surface, n_vertices, n_faces, error_m in table:
        vertex_end, face_end = vertex + int(n_vertices), face + int(n_faces)
        ladders[int(surface)].append(
            Level(vertices_m[vertex:vertex_end], faces[face:face_end], float(error_m))
        )
        vertex, face = vertex_end, face_end
    return ladders


def _write(path: Path, ladders: list[list[Level]]) -> None:
    levels = [(s, level) for s, ladder in enumerate(ladders) for level in ladder]
    table = np.array([(s, len(lv.vertices_m), len(lv.faces), lv.error_m) for s, lv in levels]).reshape(-1, 4)
    vertices_m = np.concatenate([np.zeros((0, 3)), *(level.vertices_m for _, level in levels)])
    faces = np.concatenate([np.zeros((0, 3), np.int32), *(level.faces for _, level in levels)])
    with atomic_file(path) as part:
        np.savez(part, table=table, vertices_m=vertices_m, faces=faces)
    kept = sorted(path.parent.glob("levels-*.npz"), key=lambda file: file.stat().st_mtime)
    for stale in kept[:-_MOST_BODIES]:
        stale.unlink(missing_ok=True)
