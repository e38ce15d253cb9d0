"""An actor's own mesh lies beside actor.toml, which names it."""

from pathlib import Path

import pytest

from services.mocap.body.actor import MESH_FILE, Actor
from services.mocap.body.body_mesh import OwnMesh, generic_mesh
from services.mocap.errors import TakeError
from services.mocap.take.actor_file import check_place, read_actor, rounded, write_actor

ACTOR = Actor(height=1.7, mesh=OwnMesh.of(generic_mesh()))


@pytest.fixture
def fitted(tmp_path: Path) -> Path:
    path = tmp_path / "actor.toml"
    write_actor(path, ACTOR, "nothing")
    return path


def refusal(path: Path) -> str:
    with pytest.raises(TakeError) as refused:
        read_actor(path)
    return str(refused.value).removeprefix(f"{path.parent}/")


def test_what_is_written_is_read(fitted: Path) -> None:
    assert {path.name for path in fitted.parent.iterdir()} == {fitted.name, MESH_FILE}
    assert read_actor(fitted) == ACTOR == rounded(ACTOR)
    assert MESH_FILE in fitted.read_text()
    check_place(fitted, force=False)


def test_its_file_may_have_another_name(fitted: Path) -> None:
    (fitted.parent / MESH_FILE).rename(fitted.parent / "me.npz")
    fitted.write_text(fitted.read_text().replace(f'"{MESH_FILE}"', '"me.npz"'))
    assert read_actor(fitted) == ACTOR


def test_a_missing_mesh(fitted: Path) -> None:
    (fitted.parent / MESH_FILE).unlink()
    assert refusal(fitted).startswith(f"{MESH_FILE}: is missing: expected the mesh that actor.toml names")


def test_a_changed_mesh(fitted: Path) -> None:
    with (fitted.parent / MESH_FILE).open("ab") as file:
        file.write(b"x")
    assert refusal(fitted).startswith(f"{MESH_FILE}: is not the mesh that actor.toml names")


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        ('mesh = "me.npz"\n', "mesh: expected a table with file and sha256"),
        ('[mesh]\nfile = "me.npz"\n', "mesh.sha256: is missing: expected that file's SHA-256"),
        ('[mesh]\nfile = "../me.npz"\nsha256 = "00"\n', "mesh.file: expected the name of a file next to"),
    ],
)
def test_a_mesh_that_is_named_badly(tmp_path: Path, mesh: str, said: str) -> None:
    (tmp_path / "actor.toml").write_text(mesh)
    assert refusal(tmp_path / "actor.toml").startswith(f"actor.toml: {said}")
