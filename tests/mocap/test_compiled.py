"""Compiled code is never older than any of its sources."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from services.mocap import compiled

_PACKAGE = Path(compiled.__file__).parent


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the library's sources that compiled_folder looks at."""
    copy = tmp_path / "mocap"
    shutil.copytree(_PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(compiled, "_SOURCES", copy)
    monkeypatch.setattr(compiled, "_KEPT", copy / "__pycache__")
    return copy


@pytest.mark.parametrize(
    "file",
    ["energy/cpu/crossing.py", "energy/snapping.py", "energy/cpu/mesh.py", "body/skeleton.py", "njit.py"],
)
def test_a_change_of_any_source_names_another_folder(sources: Path, file: str) -> None:
    before = compiled.compiled_folder()
    assert compiled.compiled_folder() == before
    path = sources / file
    path.write_text(path.read_text() + "\n")
    changed = compiled.compiled_folder()
    assert changed != before
    path.rename(path.with_name("moved.py"))
    assert compiled.compiled_folder() not in (before, changed)


def test_old_code_is_forgotten_and_new_code_kept(sources: Path) -> None:
    kept, old = compiled.compiled_folder(), sources / "__pycache__" / "compiled-0"
    for folder in (kept, old):
        folder.mkdir(parents=True)
    compiled.forget_other_code()
    assert kept.exists()
    assert not old.exists()


@pytest.mark.parametrize("said", [None, "/elsewhere"])
def test_the_library_says_so_before_numba_is_there(said: str | None) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment |= {"NUMBA_CACHE_DIR": said} if said else {}
    program = (
        "import services.mocap, sys, os; print('numba' in sys.modules); print(os.environ['NUMBA_CACHE_DIR'])"
    )
    told = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    loaded, folder = told.stdout.split()
    assert loaded == "False"
    assert Path(folder) == Path(said or compiled.compiled_folder())
