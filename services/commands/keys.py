"""`xormocap keys`: makes, adds, revokes and lists the keys by which services authenticate."""

import os
import re
import shutil
import stat
import tempfile
from pathlib import Path
from typing import Annotated

import typer
import zmq.auth
from rich.table import Table

from proto.keys import CLIENT, CLIENTS, COORDINATOR, PUBLIC, SECRET, SERVER, allowed_clients
from services.commands.consoles import say, stdout
from services.mocap.atomic import atomic_folder
from services.mocap.errors import UserError

ROLES = ("segmentation", "limb_worker", "recorder", "viewer")
"""Clients that get keys by default; a service finds the keys of its role by itself."""
_MOST_CLIENTS = 1000
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_SEE = "\nAfterwards tell a running coordinator: kill -HUP PID, or docker compose kill -s HUP coordinator."

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Manage keys for services on several machines.",
)
Folder = Annotated[Path, typer.Argument(help="The folder of all keys.", metavar="DIR")]
Names = Annotated[list[str], typer.Argument(help="The clients' names.", metavar="NAME...")]


@app.command()
def new(
    folder: Folder,
    clients: Annotated[
        str, typer.Option(help="Names separated by commas, or a number N for client-1 to client-N.")
    ] = ",".join(ROLES),
) -> None:
    """Make keys for a coordinator and its clients."""
    names = _client_names(clients)
    for made in (folder / name for name in (COORDINATOR, *names)):
        if made.exists():
            raise UserError(f"{made}: already exists: remove it or choose another folder")
    try:
        folder.mkdir(mode=stat.S_IRWXU, parents=True, exist_ok=True)  # it may be a volume that exists already
        with tempfile.TemporaryDirectory(dir=folder, prefix=".") as part:
            own = Path(part) / COORDINATOR
            (own / CLIENTS).mkdir(parents=True)
            own.chmod(stat.S_IRWXU)
            _make_certificate(own, SERVER)
            for name in names:
                _make_client(Path(part), name)
            for name in (*names, COORDINATOR):  # the coordinator's folder lists all clients
                (Path(part) / name).rename(folder / name)
    except OSError as problem:
        reason = problem.strerror
        raise UserError(f"{folder}: cannot be written ({reason}): choose another folder") from None
    say(f"{folder}: keys of the {COORDINATOR} and of {len(names)} clients: {', '.join(names)}")


@app.command(epilog=_SEE)
def add(folder: Folder, names: Names) -> None:
    """Make keys for more clients and give them access."""
    _require_keys(folder)
    names = list(dict.fromkeys(names))
    for name in names:
        _check_name(name)
        if (folder / name).exists() or _listed(folder, name).exists():
            raise UserError(f"{folder / name}: already exists: choose another name, or revoke it first")
    for name in names:
        _make_client(folder, name)
        say(f"{folder / name}: copy this folder to the service of that name")


@app.command(epilog=_SEE)
def revoke(folder: Folder, names: Names) -> None:
    """Revoke the access of clients and delete their keys."""
    _require_keys(folder)
    names = list(dict.fromkeys(names))
    for name in names:
        _check_name(name)
        if not _listed(folder, name).exists():
            known = ", ".join(allowed_clients(folder / COORDINATOR / CLIENTS).values()) or "nobody"
            raise UserError(f"{name}: is not on the list in {folder}, which has {known}")
    for name in names:
        _listed(folder, name).unlink()
        shutil.rmtree(folder / name, ignore_errors=True)
        say(f"{name}: has no access any more")


@app.command(name="list")
def show(folder: Folder) -> None:
    """List the clients with access."""
    _require_keys(folder)
    table = Table("client", "public key", box=None)
    for key, name in allowed_clients(folder / COORDINATOR / CLIENTS).items():
        table.add_row(name, key.decode())
    stdout.print(table, markup=False)


def _client_names(asked: str) -> list[str]:
    """The names of the option --clients."""
    if asked.isdecimal():
        if not 0 < int(asked) <= _MOST_CLIENTS:
            raise UserError(f"--clients {asked}: expected a number from 1 to {_MOST_CLIENTS}, or names")
        return [f"client-{k + 1}" for k in range(int(asked))]
    names = [name.strip() for name in asked.split(",") if name.strip()]
    for name in names:
        _check_name(name)
    if not names or len({name.lower() for name in names}) < len(names):
        raise UserError(f"--clients {asked}: expected different names separated by commas")
    return names


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name) or name == COORDINATOR:
        raise UserError(
            f"{name}: expected a client's name of up to 64 letters, digits, dots, hyphens and underscores, "
            f"other than {COORDINATOR}"
        )


def _require_keys(folder: Path) -> None:
    if not (folder / COORDINATOR / f"{SERVER}{PUBLIC}").exists():
        raise UserError(f"{folder}: expected keys in it: make them with xormocap keys new {folder}")


def _listed(folder: Path, name: str) -> Path:
    return folder / COORDINATOR / CLIENTS / f"{name}{PUBLIC}"


def _make_client(folder: Path, name: str) -> None:
    """A client's folder in the folder of all keys, and its entry in the list."""
    with atomic_folder(folder / name) as part:
        part.chmod(stat.S_IRWXU)
        _make_certificate(part, CLIENT)
        shutil.copyfile(folder / COORDINATOR / f"{SERVER}{PUBLIC}", part / f"{SERVER}{PUBLIC}")
        shutil.copyfile(part / f"{CLIENT}{PUBLIC}", _listed(folder, name))


def _make_certificate(folder: Path, name: str) -> None:
    """A pair of keys; the secret key is never readable by other users."""
    before = os.umask(stat.S_IRWXG | stat.S_IRWXO)
    try:
        zmq.auth.create_certificates(folder, name)
    finally:
        os.umask(before)
    (folder / f"{name}{SECRET}").chmod(stat.S_IRUSR | stat.S_IWUSR)
