"""GL objects that are made when first asked for and kept for the next time."""

from collections.abc import Callable
from typing import Generic, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


class Kept(Generic[Key, Value]):
    """Values by key, at most `most` of them: the one that was asked for longest ago goes first."""

    def __init__(self, make: Callable[[Key], Value], release: Callable[[Value], None], most: int) -> None:
        self._make, self._release, self._most = make, release, most
        self._values: dict[Key, Value] = {}

    def __getitem__(self, key: Key) -> Value:
        """The key's value, which holds until the next one is asked for."""
        value = self._values.pop(key, None)
        if value is None:
            value = self._make(key)
        self._values[key] = value  # the last one now
        if len(self._values) > self._most:
            self._release(self._values.pop(next(iter(self._values))))
        return value

    def clear(self) -> None:
        """Release all of them."""
        while self._values:
            self._release(self._values.popitem()[1])
