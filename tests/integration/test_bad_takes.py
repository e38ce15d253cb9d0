"""Takes that cannot be tracked end in one sentence, exit code 2, and nothing left behind."""

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from services.mocap.result.layout import journal_of
from services.mocap.take.journal import Journal

Damage = Callable[[Path], None]
Refused = Callable[..., str]


def _cut_tail(path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def _lengthen(take: Path) -> None:
    """One video; take.toml does not say how many frames are to be used."""
    shutil.copy(take / "background" / "cam02.mp4", take / "videos" / "cam02.mp4")
    path = take / "take.toml"
    path.write_text(re.sub(r"(?m)^frames = .*\n", "", path.read_text()))


def _mirror(take: Path) -> None:
    path = take / "calibration.toml"
    lines = path.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("rotation"))
    end = next(i for i, line in enumerate(lines) if i > first and "=" in line)
    lines[first:end] = ["rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]"]
    path.write_text("\n".join(lines))


def _add_field(take: Path) -> None:
    path = take / "take.toml"
    path.write_text(path.read_text() + "\nfacign = 90\n")


def _empty_png(take: Path) -> None:
    shutil.copytree(take / "reference" / "silhouettes", take / "silhouettes")
    (take / "silhouettes" / "cam03" / "000002.png").write_bytes(b"")


@pytest.mark.parametrize(
    ("damage", "named"),
    [
        (lambda take: (take / "videos" / "cam04.mp4").unlink(), "videos/cam04.mp4"),
        (_mirror, "[cam01] rotation"),
        (_lengthen, "but cam02.mp4 has 30"),
        (lambda take: _cut_tail(take / "videos" / "cam05.mp4"), "videos/cam05.mp4"),
        (_empty_png, "silhouettes/cam03/000002.png"),
        (_add_field, "facign"),
    ],
    ids=["missing video", "no rotation", "other length", "truncated video", "empty picture", "unknown field"],
)
def test_a_bad_take_ends_in_one_sentence(
    synthetic_take: Path, refused: Refused, tmp_path: Path, damage: Damage, named: str
) -> None:
    take = tmp_path / "take"
    shutil.copytree(synthetic_take, take)
    damage(take)
    said = refused("track", take, "--out", tmp_path / "out")
    assert named in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_frames_beyond_the_take_are_refused(synthetic_take: Path, tmp_path: Path) -> None:
    """By the command as a process, for once."""
    command = [sys.executable, "-m", "services.cli", "track", synthetic_take, "--out", tmp_path / "out"]
    done = subprocess.run(
        [*command, "--frames", "20:30"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "--frames 20:30: expected a range within 0:24" in done.stderr


def test_an_endpoint_that_is_no_address_is_refused_at_once(synthetic_take: Path, tmp_path: Path) -> None:
    """By the command as a process: the error is of proto, not of the user's kind."""
    command = [sys.executable, "-m", "services.cli", "track", synthetic_take, "--out", tmp_path / "out"]
    done = subprocess.run(
        [*command, "--endpoint", "here"], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert done.stderr.startswith("here: expected an address such as tcp://")
    assert not (tmp_path / "out").exists()


def test_results_that_another_run_writes_are_refused_before_the_fit(
    synthetic_take: Path, refused: Refused, tmp_path: Path
) -> None:
    journal = Journal(journal_of(tmp_path / "out"))
    journal.append([b"a frame of the other run"])
    said = refused("track", synthetic_take, "--out", tmp_path / "out")
    assert said == f"{journal.path}: another recorder is writing it: choose another folder for --out"
    assert len(list(journal.records())) == 1
    journal.close()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("max_pases=2", "--set max_pases: unknown field: did you mean max_passes"),
        ("camera_weights=[1, 1]", "camera_weights: expected 5 numbers, one for each camera of the take"),
    ],
)
def test_settings_that_cannot_be_are_refused(
    synthetic_take: Path, refused: Refused, tmp_path: Path, asked: str, said: str
) -> None:
    sentence = refused("track", synthetic_take, "--out", tmp_path / "out", "--set", asked)
    assert sentence.startswith(said)
    assert len(sentence.splitlines()) == 1
    assert not (tmp_path / "out").exists()
