"""Hostile messages: thousands for the decoder, some for real services; and what is said when one breaks."""

from itertools import islice

import pytest

from bench.soak import fuzz
from bench.soak.dice import Dice
from bench.soak.fuzz import BrokenDecoderError, fuzz_decoder
from bench.soak.hostile import Hostile
from bench.soak.sample_messages import sample_messages
from bench.soak.socket_fuzz import fuzz_sockets
from proto.framing import MAX_HEADER_BYTES, MalformedMessage, decode
from proto.messages import MESSAGES, Beat


def test_the_decoder_refuses_or_understands() -> None:
    report = fuzz_decoder(seed=1, inputs=6000)
    assert report.understood.total() + report.malformed.total() == report.inputs == 6000
    kinds = set(Hostile(Dice(1)).kinds)
    assert {*report.understood, *report.malformed} == kinds
    for kind in ("random bytes", "giant lengths", "deep nesting", "wrong version"):
        assert report.understood[kind] == 0
        assert report.malformed[kind] > 300
    assert report.malformed["replayed"] == report.malformed["foreign"] == 0
    assert report.growth_mib < 32


def _some(seed: int, count: int) -> list[tuple[str, list[bytes]]]:
    hostile = Hostile(Dice(seed))
    return list(islice(iter(hostile.next, None), count))


def test_a_seed_repeats_a_run() -> None:
    assert _some(3, 500) == _some(3, 500) != _some(4, 500)


def test_every_type_is_attacked() -> None:
    assert set(sample_messages("walk", 3)) == set(MESSAGES)
    understood = set()
    for _, frames in _some(5, 2000):
        try:
            understood.add(decode(frames).type)
        except MalformedMessage:
            continue
    assert understood == set(MESSAGES)


def test_some_are_longer_than_a_header_may_be() -> None:
    assert any(len(frames[0]) > MAX_HEADER_BYTES for _, frames in _some(6, 3000) if frames)


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (lambda _: 1 / 0, "ZeroDivisionError"),
        (lambda _: (_ for _ in ()).throw(MalformedMessage("x" * 1000)), "a reason that does not fit a log"),
    ],
)
def test_a_broken_decoder_is_told_with_its_input(broken, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz, "_decode", broken)
    with pytest.raises(BrokenDecoderError, match=r"^--seed 9, input 0 \(") as failure:
        fuzz_decoder(seed=9, inputs=10)
    assert said in str(failure.value)


def test_a_message_that_changes_on_its_way_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([Beat(), decode(sample_messages("walk", 1)["credit"])] * 20)
    monkeypatch.setattr(fuzz, "decode", lambda _: next(answers))
    with pytest.raises(BrokenDecoderError, match="is another message"):
        fuzz_decoder(seed=9, inputs=10)


@pytest.mark.timeout(580)
def test_services_under_fire_track_as_in_quiet() -> None:
    report = fuzz_sockets(seed=2, messages=500, frames=8)
    assert report.sent["limb_worker"] == 500
    assert "'malformed': 0" not in report.counted
    assert max(report.growth_mib.values()) < 32
