"""actor.toml: what a fit writes can be read, and what a person wrote is not lost."""

from pathlib import Path

import pytest

from services.mocap.body.actor import Actor
from services.mocap.body.profiles import Profile
from services.mocap.errors import UserError
from services.mocap.take.actor_file import check_place, read_actor, rounded, write_actor

ACTOR = rounded(
    Actor(
        height=1.7 + 1 / 300,
        bone_lengths={"thigh": 0.43 + 1 / 30000},
        profiles={"torso": Profile(width=(1.0, 1.1 + 1 / 30000), depth=(0.9,))},
    )
)


@pytest.fixture
def fitted(tmp_path: Path) -> Path:
    path = tmp_path / "actor.toml"
    write_actor(path, ACTOR, "frames 0 to 9 of 'walk'")
    return path


def test_what_is_written_is_read(fitted: Path) -> None:
    assert read_actor(fitted) == ACTOR
    assert read_actor(fitted).content_hash == ACTOR.content_hash


def test_numbers_are_short_and_explained(fitted: Path) -> None:
    text = fitted.read_text()
    assert "height = 1.7033\n" in text
    assert "thigh = 0.43\n" in text
    assert "metres" in text
    assert "frames 0 to 9 of 'walk'" in text
    assert ACTOR.content_hash in text


def test_a_fit_may_take_the_place_of_a_fit_or_of_nothing(fitted: Path, tmp_path: Path) -> None:
    check_place(fitted, force=False)
    check_place(tmp_path / "new" / "actor.toml", force=False)


@pytest.mark.parametrize(
    "text",
    [
        "height = 1.78\n",
        f"# sha256 = {ACTOR.content_hash}\nheight = 1.78\n",
        f"# sha256 = {ACTOR.content_hash}\nheight = \n",
        "\udcff",
    ],
    ids=["by hand", "changed", "broken", "no text"],
)
def test_what_a_person_wrote_is_kept_unless_forced(fitted: Path, text: str) -> None:
    fitted.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(UserError, match=r"actor\.toml: was made or changed by hand: .*--out.*--force"):
        check_place(fitted, force=False)
    check_place(fitted, force=True)


def test_one_changed_number_counts(fitted: Path) -> None:
    fitted.write_text(fitted.read_text().replace("thigh = 0.43", "thigh = 0.44"))
    with pytest.raises(UserError, match="changed by hand"):
        check_place(fitted, force=False)


def test_a_folder_that_cannot_be_written_to_is_said_before_the_work(
    fitted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # root may write everywhere
    with pytest.raises(UserError, match="cannot be written to: give another folder with --out"):
        check_place(fitted, force=True)
