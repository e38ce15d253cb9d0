"""Messages as an enemy, or a broken program, would send them: every kind by a function of its own."""

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import msgpack

from bench.soak.dice import Dice
from bench.soak.sample_messages import sample_messages
from proto.framing import MAX_FRAME_BYTES
from proto.messages import PROTOCOL_VERSION

Frames: TypeAlias = list[bytes]
_GIANT = (
    b"\xdb\xff\xff\xff\xff",  # a string, binary, array, map and extension of four gigabytes or entries
    b"\xc6\xff\xff\xff\xff",
    b"\xdd\xff\xff\xff\xff",
    b"\xdf\xff\xff\xff\xff",
    b"\xc9\xff\xff\xff\xff\x01",
    b"\xdd\x00\x0f\xff\xff",  # and some that could nearly be
    b"\xdf\x00\x00\xff\xff",
)
_SIZES = (-1, 0, 1, 2**16, MAX_FRAME_BYTES, MAX_FRAME_BYTES + 1, 2**31, 2**32, 2**63, 2**64 - 1)
_DEEPEST = 3000


class Hostile:
    """Makes hostile messages of every kind; the same ones for the same dice."""

    def __init__(self, dice: Dice, take: str = "walk", frame: int = 7) -> None:
        """Most are about a frame of a take."""
        self._dice = dice
        self._valid = sample_messages(take, frame)
        self._types = sorted(self._valid)
        self._headers = {name: msgpack.unpackb(frames[0]) for name, frames in self._valid.items()}
        self._fields = sorted({field for header in self._headers.values() for field in header})
        self.kinds: dict[str, Callable[[], Frames]] = {
            "random bytes": self._random,
            "truncated": self._truncated,
            "mutated": self._mutated,
            "giant lengths": self._giant,
            "wrong sizes": self._wrong_sizes,
            "wrong types": self._wrong_types,
            "deep nesting": self._deep,
            "crowded": self._crowded,
            "wrong version": self._wrong_version,
            "replayed": self._replayed,
            "foreign": self._foreign,
            "frames amiss": self._frames_amiss,
        }

    def next(self) -> tuple[str, Frames]:
        """A message and what kind it is."""
        kind = self._dice.pick(tuple(self.kinds))
        return kind, self.kinds[kind]()

    def _any(self) -> tuple[dict[str, Any], Frames]:
        """A well-formed message to spoil: a copy of its header, and its arrays."""
        name = self._dice.pick(self._types)
        return dict(self._headers[name]), self._valid[name][1:]

    def _random(self) -> Frames:
        return [self._dice.bytes(self._dice.below(80)) for _ in range(self._dice.below(4))]

    def _truncated(self) -> Frames:
        frames = list(self._valid[self._dice.pick(self._types)])
        k = self._dice.below(len(frames))
        frames[k] = frames[k][: self._dice.below(len(frames[k]) + 1)]
        return frames

    def _mutated(self) -> Frames:
        """Some bytes or bits of a well-formed message changed."""
        frames = list(self._valid[self._dice.pick(self._types)])
        k = 0 if self._dice.below(2) else self._dice.below(len(frames))
        changed = bytearray(frames[k])
        for _ in range(1 + self._dice.below(4)):
            if changed:
                place = self._dice.below(len(changed))
                changed[place] ^= 1 << self._dice.below(8) if self._dice.below(2) else self._dice.below(256)
        frames[k] = bytes(changed)
        return frames

    def _giant(self) -> Frames:
        """A length that the rest does not live up to, where a value begins."""
        header, arrays = self._any()
        packed, mark = msgpack.packb(header), msgpack.packb(self._dice.pick(tuple(header)))
        place = packed.find(mark) + len(mark)
        return [packed[:place] + self._dice.pick(_GIANT) + packed[place + 1 :], *arrays]

    def _wrong_sizes(self) -> Frames:
        header, arrays = self._any()
        header["shapes"] = [
            [self._dice.pick(_SIZES) if self._dice.below(2) else size for size in shape]
            for shape in header["shapes"]
        ] + [[self._dice.pick(_SIZES)]] * self._dice.below(2)
        return [msgpack.packb(header), *arrays]

    def _wrong_types(self) -> Frames:
        header, arrays = self._any()
        for _ in range(1 + self._dice.below(2)):
            header[self._dice.pick(tuple(header))] = self._junk(2)
        if not self._dice.below(4):
            header[self._dice.pick(self._fields)] = self._junk(2)
        return [msgpack.packb(header), *arrays]

    def _junk(self, depth: int) -> Any:
        made: tuple[Callable[[], Any], ...] = (
            lambda: self._dice.pick((None, True, False, math.nan, math.inf, -math.inf, -0.0, 1e308)),
            lambda: self._dice.pick((0, -1, 7, 2**31 - 1, 2**31, 2**53 + 1, 2**64 - 1, -(2**63))),
            lambda: self._dice.pick(("", "walk", "\x00", "\n" * 300, "é" * 250, "left_arm")),
            lambda: self._dice.bytes(self._dice.below(9)),
            lambda: msgpack.ExtType(self._dice.below(128), self._dice.bytes(3)),
            lambda: msgpack.Timestamp(self._dice.below(2**32)),
            lambda: [self._junk(depth - 1) for _ in range(self._dice.below(4))],
            lambda: {str(k): self._junk(depth - 1) for k in range(self._dice.below(4))},
        )
        return made[self._dice.below(len(made) if depth else 6)]()

    def _deep(self) -> Frames:
        header, arrays = self._any()
        depth, field = 1 + self._dice.below(_DEEPEST), self._dice.pick(tuple(header))
        opening = self._dice.pick((b"\x91", b"\x81\xa1a", b"\x91\x81\xa1a"))
        nested = opening * depth + b"\xc0"
        others = {name: value for name, value in header.items() if name != field}
        packed = msgpack.packb(others)
        start = 1 if packed[0] < 0xDE else 3  # behind a map's head, short or long
        head = b"\xde" + len(header).to_bytes(2, "big")
        return [head + msgpack.packb(field) + nested + packed[start:], *arrays]

    def _crowded(self) -> Frames:
        """As many entries as the limit lets in, in the header, in a map or in a list."""
        header, arrays = self._any()
        count = self._dice.below(self._dice.pick((50, 50, 1500, 12_000)))
        field = self._dice.pick((*header, ""))
        if field:
            junk = self._dice.pick((0, -1, 0.5, "", None))
            header[field] = [junk] * count if self._dice.below(2) else {str(k): junk for k in range(count)}
        else:
            header |= {str(k): 0 for k in range(count)}
        return [msgpack.packb(header), *arrays]

    def _wrong_version(self) -> Frames:
        header, arrays = self._any()
        header["v"] = self._dice.pick(
            (0, 1, PROTOCOL_VERSION + 1, -1, 2**63, float(PROTOCOL_VERSION), "2", None)
        )
        return [msgpack.packb(header), *arrays]

    def _replayed(self) -> Frames:
        """A well-formed message, once more."""
        return list(self._valid[self._dice.pick(self._types)])

    def _foreign(self) -> Frames:
        """A well-formed message about another take, frame, limb or content."""
        header, arrays = self._any()
        changes: dict[str, Any] = {
            "take": f"take {self._dice.below(1000)}",
            "frame": self._dice.below(2**31),
            "pass_index": self._dice.below(2**31),
            "hash": self._dice.bytes(32).hex(),
            "limb": self._dice.pick(("left_leg", "right_leg", "right_arm")),
            "end_frame": self._dice.below(2**31),
        }
        header |= {name: value for name, value in changes.items() if name in header}
        return [msgpack.packb(header), *arrays]

    def _frames_amiss(self) -> Frames:
        """Frames left out, repeated, in another order, emptied, or another message's."""
        header, arrays = self._any()
        frames = [msgpack.packb(header), *arrays]
        fault = self._dice.below(5)
        if fault == 0:
            return frames[: self._dice.below(len(frames))]
        if fault == 1:
            return frames * (2 + self._dice.below(20))
        if fault == 2:
            return frames[::-1]
        if fault == 3:
            return [frames[0], *[b""] * len(arrays)]
        return [frames[0], *self._valid[self._dice.pick(self._types)][1:]]
