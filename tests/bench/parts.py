"""What scripts/bench page measures, part by part."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from rich.table import Table

from bench import first_view, page, slow_browser
from bench.line import Line
from bench.takes import take_folder


class Part(StrEnum):
    """One measurement of the page."""

    FIRST = "first"
    SLOW = "slow"
    COST = "cost"


@dataclass(frozen=True)
class Plan:
    """How the parts are measured."""

    take: str
    """A folder, or a motion's name."""
    line: Line
    slow_s: float
    """How long a slow browser looks."""
    rounds: int
    """Of the cost."""
    screenshot: Path | None
    """Where a picture of the first view goes."""


def measured(part: Part, plan: Plan, tell: Callable[[str], None]) -> Iterator[tuple[Table, list[Any]]]:
    """A part's table and rows; raises UserError."""
    take = take_folder(plan.take)
    if part is Part.FIRST:
        tell("opening the page while all starts, about a minute")
        row = first_view.measure(take, plan.screenshot)
        yield first_view.as_table(row), [row]
    elif part is Part.SLOW:
        tell(f"looking from behind a slow line, {plan.slow_s:.0f} s and some more")
        late = slow_browser.measure(take, plan.line, plan.slow_s)
        yield slow_browser.as_table(late, plan.line), late
    else:
        rows = page.measure(take, plan.rounds, tell)
        yield page.as_table(rows), rows
