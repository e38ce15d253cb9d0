"""The results folder: checks its present content, and replaces it as a whole."""

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.mocap.atomic import atomic_folder
from services.mocap.errors import UserError
from services.mocap.result.layout import KNOWN, POSES, RUN_JSON, journal_of, partial_of
from services.mocap.take.journal import JOURNAL, check_unused

_OLD = ".old"


def check_out(folder: Path) -> None:
    """Raise UserError if a folder cannot hold results, holds other files, or if a recorder writes its
    results now."""
    _check_content(folder.resolve())
    check_unused(journal_of(folder))


def _check_content(folder: Path) -> None:
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    if not existing.is_dir():
        raise UserError(f"{existing}: is a file: expected a folder for the results")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise UserError(f"{existing}: cannot be written to: choose another folder for --out")
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    # A user's own calibration.toml or actor.toml has the name of a result's file.
    are_results = bool(there & {RUN_JSON, POSES, JOURNAL})
    others = sorted(there - KNOWN if are_results else there)
    if others:
        raise UserError(
            f"{folder}: contains other files than results ({others[0]}): choose another folder for --out"
        )


def clear_leftovers(out: Path) -> None:
    """Remove the leftovers of a recorder that died while writing the results of this folder."""
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
    """Yield a new folder, which replaces out if the block ends without an error.

    Incomplete results never replace older ones; they go to partial_of(out) instead.
    """
    out = out.resolve()
    if not complete and (out / RUN_JSON).exists():
        out = partial_of(out)
    _check_content(out)
    fresh = out.with_name(f".{out.name}.{secrets.token_hex(4)}.new")
    with atomic_folder(fresh) as part:
        yield part
    _put_in_place(fresh, out)


def _put_in_place(fresh: Path, out: Path) -> None:
    if not out.exists():
        fresh.rename(out)
        return
    if (out / JOURNAL).exists():  # the journal is in use, and is kept longer than these results
        _move_into(fresh, out)
        return
    old = out.with_name(f".{out.name}.{secrets.token_hex(4)}{_OLD}")
    try:
        out.rename(old)
    except OSError:  # out is a mount point, which cannot be replaced
        _move_into(fresh, out)
        return
    fresh.rename(out)
    shutil.rmtree(old)


def _move_into(fresh: Path, out: Path) -> None:
    """Replace the results in a folder that cannot be replaced itself.

    The earlier poses stay until the new ones replace them: by these a folder of results is known. The report
    goes last, because it marks them complete.
    """
    (out / RUN_JSON).unlink(missing_ok=True)
    for path in out.iterdir():
        if path.is_file() and path.name not in (JOURNAL, POSES):
            path.unlink()
    for path in sorted(fresh.iterdir(), key=lambda path: path.name == RUN_JSON):
        shutil.move(path, out / path.name)
    fresh.rmdir()
