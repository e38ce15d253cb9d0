"""`xormocap keys`: what it makes, refuses and says."""

import stat
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proto.keys import allowed_clients, client_keys, server_keys
from services.commands.keys import ROLES, app
from services.mocap.errors import UserError


def keys(*arguments: object) -> str:
    done = CliRunner().invoke(app, list(map(str, arguments)), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def refusal(*arguments: object) -> str:
    with pytest.raises(UserError) as refused:
        keys(*arguments)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def names(folder: Path) -> set[str]:
    return set(allowed_clients(server_keys(folder).clients).values())


def test_all_roles_get_keys_that_fit(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "keys"
    keys("new", folder)
    assert names(folder) == set(ROLES)
    own = {role: client_keys(folder, role) for role in ROLES}
    assert {k.server for k in own.values()} == {server_keys(folder).public}
    assert {k.public for k in own.values()} == set(allowed_clients(server_keys(folder).clients))
    assert len({k.secret for k in own.values()} | {server_keys(folder).secret}) == len(ROLES) + 1


def test_secrets_are_private(tmp_path: Path) -> None:
    keys("new", tmp_path / "keys")
    keys("add", tmp_path / "keys", "other")
    secrets = list((tmp_path / "keys").rglob("*.key_secret"))
    assert len(secrets) == len(ROLES) + 2
    for path in secrets:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert stat.S_IMODE((tmp_path / "keys").stat().st_mode) == 0o700


def test_clients_by_name_or_number(tmp_path: Path) -> None:
    keys("new", tmp_path / "a", "--clients", "3")
    assert names(tmp_path / "a") == {"client-1", "client-2", "client-3"}
    keys("new", tmp_path / "b", "--clients", "left, right")
    assert names(tmp_path / "b") == {"left", "right"}


def test_a_volume_that_is_there_already_is_filled(tmp_path: Path) -> None:
    keys("new", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"coordinator", *ROLES}


def test_keys_are_never_replaced(tmp_path: Path) -> None:
    keys("new", tmp_path / "keys")
    before = server_keys(tmp_path / "keys")
    assert "already exists" in refusal("new", tmp_path / "keys")
    assert "already exists" in refusal("add", tmp_path / "keys", "more", "recorder")
    assert not (tmp_path / "keys" / "more").exists()
    assert server_keys(tmp_path / "keys") == before


def test_added_revoked_and_listed(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    keys("new", folder, "--clients", "ann")
    keys("add", folder, "bob", "eve", "bob")
    bob = client_keys(folder, "bob")
    assert bob.public.decode() in keys("list", folder)
    keys("revoke", folder, "bob", "bob")
    assert names(folder) == {"ann", "eve"}
    assert not (folder / "bob").exists()
    assert bob.public.decode() not in keys("list", folder)
    assert refusal("revoke", folder, "bob") == f"bob: is not on the list in {folder}, which has ann, eve"
    keys("add", folder, "bob")
    assert client_keys(folder, "bob").public != bob.public


@pytest.mark.parametrize("name", ["coordinator", "..", "../x", "a/b", "", ".hidden", "-x y", "x" * 65, "é"])
def test_names_that_cannot_be(tmp_path: Path, name: str) -> None:
    keys("new", tmp_path / "keys")
    assert "expected a client's name" in refusal("add", tmp_path / "keys", "--", name)


@pytest.mark.parametrize("clients", ["0", "1001", ",", "a,A", "a,coordinator"])
def test_clients_that_cannot_be(tmp_path: Path, clients: str) -> None:
    assert "expected" in refusal("new", tmp_path / "keys", "--clients", clients)
    assert not (tmp_path / "keys").exists()


def test_folders_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "cannot be written" in refusal("new", tmp_path / "file")
    for command in ("list", "add", "revoke"):
        assert "xormocap keys new" in refusal(command, tmp_path, *(["ann"] * (command != "list")))
