"""CURVE keys in folders: the coordinator's, a client's, and the list of clients with access.

    KEYS/coordinator/   server.key_secret, server.key, clients/NAME.key
    KEYS/NAME/          client.key_secret, client.key, server.key: all that this client needs

The folder clients/ is the list: a client whose file is removed has no access any more. Files are zmq.auth
certificates. On several hosts each gets only its own folder; on one host use KEYS as a whole.
"""

import logging
import stat
import struct
from dataclasses import dataclass, field
from pathlib import Path

from zmq.auth import load_certificate
from zmq.utils import z85

log = logging.getLogger(__name__)

COORDINATOR = "coordinator"
"""The coordinator's folder in a folder of keys; no client may have this name."""
SERVER, CLIENT = "server", "client"
"""Names of certificates."""
CLIENTS = "clients"
"""The folder with the public keys of the clients with access."""
PUBLIC, SECRET = ".key", ".key_secret"
_KEY_CHARACTERS = 40


class KeysError(ValueError):
    """Keys are missing or cannot be used; the text names the file and says what to do."""


@dataclass(frozen=True)
class ServerKeys:
    """What a coordinator needs to listen."""

    public: bytes
    secret: bytes = field(repr=False)
    """Keys in Z85, 40 characters, here and below."""
    clients: Path
    """The folder with the public keys of the clients with access."""


@dataclass(frozen=True)
class ClientKeys:
    """What a client needs to connect."""

    public: bytes
    secret: bytes = field(repr=False)
    server: bytes
    """The coordinator's public key; the client accepts no other coordinator."""


def server_keys(folder: Path) -> ServerKeys:
    """The coordinator's keys, from its own folder or from the folder of all keys; raises KeysError."""
    own = _own_folder(folder, COORDINATOR, SERVER)
    public, secret = _pair(own / f"{SERVER}{SECRET}")
    if not (own / CLIENTS).is_dir():
        raise KeysError(f"{own / CLIENTS}: is missing: expected a folder with the public key of every client")
    return ServerKeys(public, secret, own / CLIENTS)


def client_keys(folder: Path, role: str) -> ClientKeys:
    """A client's keys, from its own folder or from the role's folder in that of all keys; raises
    KeysError."""
    own = _own_folder(folder, role, CLIENT)
    public, secret = _pair(own / f"{CLIENT}{SECRET}")
    return ClientKeys(public, secret, read_public(own / f"{SERVER}{PUBLIC}"))


def allowed_clients(folder: Path) -> dict[bytes, str]:
    """Names of the clients with access, by public key; files without a key are ignored with a warning."""
    names: dict[bytes, str] = {}
    for path in sorted(folder.glob(f"*{PUBLIC}")):
        try:
            names[read_public(path)] = path.name.removesuffix(PUBLIC)
        except KeysError as error:
            log.warning("this file gives no access: %s", error)
    return names


def read_public(path: Path) -> bytes:
    """The public key of a certificate; raises KeysError."""
    return _read(path)[0]


def _own_folder(folder: Path, name: str, certificate: str) -> Path:
    """The folder of a secret certificate: the folder itself, or its sub-folder of that name."""
    for own in (folder, folder / name):
        try:
            if (own / f"{certificate}{SECRET}").exists():
                return own
        except PermissionError:
            raise KeysError(
                f"{own}: cannot be read by the user of this service: run it as the folder's owner, or "
                "chown the folder"
            ) from None
    wanted = f"{certificate}{SECRET}, there or in {name}/"
    raise KeysError(f"{folder}: expected the keys {wanted}: make them with xormocap keys new {folder}")


def _pair(path: Path) -> tuple[bytes, bytes]:
    public, secret = _read(path)
    if secret is None:
        raise KeysError(f"{path}: contains no secret key: make keys with xormocap keys new DIR")
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        log.warning("%s: other users of this machine can read it: chmod 600 makes it private", path)
    return public, secret


def _read(path: Path) -> tuple[bytes, bytes | None]:
    """The keys of a certificate, public and secret."""
    try:
        public, secret = load_certificate(path)
    except OSError as error:
        reason = error.strerror or "it is missing"
        raise KeysError(f"{path}: cannot be read ({reason}): expected a certificate") from None
    except (ValueError, IndexError):
        raise KeysError(f"{path}: contains no public key: expected a certificate") from None
    for key in (public, secret or public):
        try:
            is_key = len(key) == _KEY_CHARACTERS and z85.encode(z85.decode(key)) == key
        except (KeyError, struct.error):  # characters that are not Z85, or a number that is too large
            is_key = False
        if not is_key:
            raise KeysError(f"{path}: contains a damaged key: expected {_KEY_CHARACTERS} characters of Z85")
    return public, secret
