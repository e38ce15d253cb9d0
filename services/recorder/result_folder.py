"""The folder that results go to: what may be there already, and how new results take its place whole."""

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.mocap.atomic import atomic_folder
from services.mocap.errors import UserError
from services.mocap.result.layout import KNOWN, RUN_JSON, partial_of
from services.mocap.take.journal import JOURNAL

_OLD = ".old"


def check_out(folder: Path) -> None:
    """Raise UserError unless results may go to a folder: one to be made, or one of results only."""
    folder = folder.resolve()
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    if not existing.is_dir():
        raise UserError(f"{existing}: is a file: expected a folder for the results")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise UserError(f"{existing}: cannot be written to: choose another folder for --out")
    others = sorted({path.name for path in folder.iterdir()} - KNOWN) if folder.is_dir() else []
    if others:
        raise UserError(
            f"{folder}: holds other files than results ({others[0]}): choose another folder for --out"
        )


def clear_leftovers(out: Path) -> None:
    """Undo what a recorder has left half-done that died while it wrote the results of this folder."""
    for folder in (out.resolve(), partial_of(out)):
        name, tag = re.escape(folder.name), "[0-9a-f]{8}"
        parts = re.compile(rf"\.{name}\.{tag}\.(new|old)|\.\.{name}\.{tag}\.{tag}\.part\.new")
        found = [path for path in folder.parent.glob(".*") if parts.fullmatch(path.name)]
        for path in found:
            if path.suffix == _OLD and not folder.exists():
                path.rename(folder)
            else:
                shutil.rmtree(path, ignore_errors=True)


@contextmanager
def results_into(out: Path, complete: bool) -> Iterator[Path]:
    """Fill a new folder, which takes the place of out when the block ends well.

    Results that are not complete never replace older ones; then partial_of(out) takes them.
    """
    out = out.resolve()
    if not complete and (out / RUN_JSON).exists():
        out = partial_of(out)
    check_out(out)
    fresh = out.with_name(f".{out.name}.{secrets.token_hex(4)}.new")
    with atomic_folder(fresh) as part:
        yield part
    _put_in_place(fresh, out)


def _put_in_place(fresh: Path, out: Path) -> None:
    if not out.exists():
        fresh.rename(out)
        return
    if (out / JOURNAL).exists():  # it is being written to, and outlasts these results
        _move_into(fresh, out)
        return
    old = out.with_name(f".{out.name}.{secrets.token_hex(4)}{_OLD}")
    try:
        out.rename(old)
    except OSError:  # out is a mount point, which stays
        _move_into(fresh, out)
        return
    fresh.rename(out)
    shutil.rmtree(old)


def _move_into(fresh: Path, out: Path) -> None:
    """Replace the results in a folder that stays; the report goes last, since it says that all is there."""
    (out / RUN_JSON).unlink(missing_ok=True)
    for path in out.iterdir():
        if path.is_file() and path.name != JOURNAL:
            path.unlink()
    for path in sorted(fresh.iterdir(), key=lambda path: path.name == RUN_JSON):
        shutil.move(path, out / path.name)
    fresh.rmdir()
