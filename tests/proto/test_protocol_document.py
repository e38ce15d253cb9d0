"""PROTOCOL.md says what the code does: every table, example and byte of it."""

import hashlib
import re
from pathlib import Path

import numpy as np
import protocol_tables
import pytest

from proto.framing import decode, encode
from proto.messages import MESSAGES, PROTOCOL_VERSION, Silhouettes
from proto.streams import DEFAULT_ENDPOINT
from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig

_DOCUMENT = Path(__file__).resolve().parents[2] / "proto" / "PROTOCOL.md"
_SECTIONS = protocol_tables.message_sections()


@pytest.fixture(scope="module")
def document() -> str:
    return _DOCUMENT.read_text(encoding="utf-8")


def assert_says(document: str, expected: str) -> None:
    assert expected + "\n" in document, f"PROTOCOL.md should read:\n\n{expected}\n"


def section(document: str, heading: str) -> str:
    """The text under a heading, up to the next of its level."""
    level = heading.split(" ")[0]
    _, found, rest = document.partition(f"\n{heading}\n")
    assert found, f"PROTOCOL.md has no section {heading}"
    return re.split(rf"^{level} ", rest, flags=re.MULTILINE)[0]


def code_block(text: str, language: str) -> str:
    found = re.search(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


@pytest.mark.parametrize("name", MESSAGES)
def test_every_message_is_told_field_by_field(document: str, name: str) -> None:
    assert_says(document, _SECTIONS[name])


def test_no_other_message_is_told(document: str) -> None:
    told = re.findall(r"^### `(.*)`$", section(document, "## Messages"), flags=re.MULTILINE)
    assert told == list(MESSAGES)


def test_streams_numbers_pose_and_limbs(document: str) -> None:
    for table in (
        protocol_tables.streams_table(),
        protocol_tables.numbers_table(),
        protocol_tables.pose_table(),
        protocol_tables.limbs_table(),
        protocol_tables.quantities_table(),
    ):
        assert_says(document, table)
    assert DEFAULT_ENDPOINT in document
    assert f"version {PROTOCOL_VERSION}" in document


def test_the_message_byte_by_byte(document: str) -> None:
    rows = re.findall(
        r"^\| (header|frame 1) \| `([0-9a-f ]+)` \| .+ \|$",
        section(document, "## One message byte by byte"),
        flags=re.MULTILINE,
    )
    frames = [
        b"".join(bytes.fromhex(cells) for where, cells in rows if where == name)
        for name in ("header", "frame 1")
    ] + [b""] * 2
    planes = np.array([[[0, 1, 0], [0, 3, 2]]], np.uint8)
    run = "0123456789abcdef0123456789abcdef"
    message = Silhouettes(take="walk", run=run, frame=7, cameras=[0, 1], planes=planes)
    assert [bytes(frame) for frame in encode(message)] == frames
    told = f"a header of {len(frames[0])} bytes, one\narray frame of {len(frames[1])} and two empty ones."
    assert told in document
    back = decode(frames)
    assert isinstance(back, Silhouettes)
    np.testing.assert_array_equal(back.planes, planes)


def test_the_actor_example(document: str) -> None:
    told = section(document, "### Blob of kind `actor`")
    text = code_block(told, "toml")
    actor = Actor.from_toml(text)
    assert actor.to_toml() == text
    assert actor.content_hash == hashlib.sha256(text.encode()).hexdigest()
    assert f"`{actor.content_hash}`" in told


def test_the_rig_example(document: str) -> None:
    told = section(document, "### Blob of kind `rig`")
    text = code_block(told, "json").removesuffix("\n")
    rig = Rig.from_json(text)
    assert rig.to_json() == text
    assert f"`{rig.content_hash}`" in told
    homogeneous = rig.P_px_world[0] @ [0.0, 0.0, 1.0, 1.0]
    np.testing.assert_allclose(homogeneous[:2] / homogeneous[2], [159.5, 119.5])
    assert "(159.5, 119.5)" in told


def test_links_lead_somewhere(document: str) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", document):
        assert (_DOCUMENT.parent / target).exists(), target
