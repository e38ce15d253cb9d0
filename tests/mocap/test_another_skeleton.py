"""Further parameters of joints take a change of the skeleton's table, and of nothing else."""

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from services.mocap.compiled import compiled_folder

CHECKS = Path(__file__).with_name("another_skeleton.py")


@pytest.mark.timeout(1200)
def test_all_there_is_works_with_another_skeleton(request: pytest.FixtureRequest) -> None:
    """What is compiled for that skeleton is kept between runs, as it takes a minute or two."""
    assert request.config.cache is not None
    kept = request.config.cache.mkdir("another-skeleton")
    sources = hashlib.sha256(CHECKS.read_bytes() + compiled_folder().name.encode()).hexdigest()[:16]
    for other in kept.iterdir():
        if other.name != sources:
            shutil.rmtree(other, ignore_errors=True)
    alone = ("--noconftest", "-p", "no:xdist", "-p", "no:cacheprovider", "-o", "timeout=0")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *alone, CHECKS],
        env=os.environ | {"NUMBA_CACHE_DIR": str(kept / sources)},
        cwd=CHECKS.parents[2],
        capture_output=True,
        text=True,
        timeout=1200,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "[100%]" in done.stdout
