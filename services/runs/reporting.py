"""What fits tell while they work: stages with their times, progress, and warnings."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

DRAWING_FROM = 0.97
_SHARES = {"looking at silhouettes": 0.08, "finding the first pose": 0.2, "fitting the actor": DRAWING_FROM}
"""Total progress at the end of each stage; drawing follows."""

Show = Callable[[str, float], None]
"""Called with the current stage, in words, and the total progress, 0 to 1."""


class Clock:
    """Measures the stages' times and reports the total progress."""

    def __init__(self, show: Show) -> None:
        self._show, self._from = show, 0.0
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        """Yields a function that takes the progress within the stage, 0 to 1."""
        began_s, start, end = time.perf_counter(), self._from, _SHARES[name]
        self._show(name, start)
        yield lambda share: self._show(name, start + share * (end - start))
        self._from = end
        self.seconds[name] = time.perf_counter() - began_s


class _Keeper(logging.Handler):
    """Stores what was logged, each sentence once."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.sentences: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if (sentence := record.getMessage()) not in self.sentences:
            self.sentences.append(sentence)


@contextmanager
def kept_warnings() -> Iterator[list[str]]:
    """Collects the library's warnings, to show them to the user; of nested blocks only the innermost
    collects."""
    logger, keeper = logging.getLogger("services"), _Keeper()
    outer = [handler for handler in logger.handlers if isinstance(handler, _Keeper)]
    for handler in outer:
        logger.removeHandler(handler)
    logger.addHandler(keeper)
    try:
        yield keeper.sentences
    finally:
        logger.removeHandler(keeper)
        for handler in outer:
            logger.addHandler(handler)
