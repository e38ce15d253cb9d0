import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from services.mocap.atomic import atomic_file, atomic_folder
from services.mocap.errors import UserError


def test_a_file_appears_whole_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "out" / "motion.bvh"
    with atomic_file(target) as part:
        part.write_text("whole")
        assert part.suffix == ".bvh"
        assert part.parent == target.parent
        assert not target.exists()
    assert target.read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]


def test_an_exception_leaves_the_older_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "motion.bvh"
    target.write_text("older")
    with pytest.raises(KeyboardInterrupt), atomic_file(target) as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert target.read_text() == "older"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("atomic", [atomic_file, atomic_folder])
def test_a_full_disk_is_one_sentence(
    tmp_path: Path, atomic: Callable[[Path], AbstractContextManager[Path]]
) -> None:
    target, remedy = tmp_path / "results", "free some disk space, or choose another folder"
    with pytest.raises(UserError) as refused, atomic(target):
        Path("/dev/full").write_text("too much")
    assert str(refused.value) == f"{target}: cannot be written (No space left on device): {remedy}"
    assert not list(tmp_path.iterdir())
    with pytest.raises(UserError) as refused, atomic(target):
        raise shutil.Error([("one", "other", "[Errno 28] No space left on device")])
    assert str(refused.value) == (
        f"one: cannot be copied to {target} ([Errno 28] No space left on device): {remedy}"
    )
    with pytest.raises(FileNotFoundError), atomic(target):
        (tmp_path / "nothing").read_text()


@pytest.mark.parametrize("atomic", [atomic_file, atomic_folder])
def test_a_failing_disk_need_not_be_that_of_the_target(
    tmp_path: Path, atomic: Callable[[Path], AbstractContextManager[Path]]
) -> None:
    with pytest.raises(UserError) as refused, atomic(tmp_path / "results"):
        Path("/proc/self/mem").read_bytes()  # an input/output error
    assert str(refused.value) == (
        f"{tmp_path}/results: cannot be completed, as a disk that is read or written fails "
        "([Errno 5] Input/output error): check the disks, or choose another folder"
    )


def test_a_folder_appears_whole_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "takes" / "one"
    target.mkdir(parents=True)  # an empty folder may be filled
    with atomic_folder(target) as part:
        (part / "take.toml").write_text("whole")
        assert not any(target.iterdir())
    assert (target / "take.toml").read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]


def test_an_exception_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), atomic_folder(tmp_path / "one") as part:
        (part / "videos").mkdir()
        raise ZeroDivisionError
    assert not any(tmp_path.iterdir())


def test_a_folder_of_the_users_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(UserError, match="already exists: remove it") as refused, atomic_folder(tmp_path):
        pytest.fail("the block must not run")
    assert str(refused.value).startswith(f"{tmp_path}: ")
    assert (tmp_path / "note.txt").read_text() == "mine"


def test_a_place_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be created"), atomic_file(tmp_path / "file" / "x.csv"):
        pytest.fail("the block must not run")


def test_the_current_folder_can_be_filled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with atomic_file(Path("x.csv")) as part:
        part.write_text("whole")
    assert (tmp_path / "x.csv").read_text() == "whole"
