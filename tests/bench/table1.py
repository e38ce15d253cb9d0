"""The paper's table 1: energy evaluations per second by window: plain, pre-rendered, with colours."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.table import Table

from bench.candidates import Candidates
from bench.problems import Case, Scene, Setup
from bench.rates import median_rates

RIVAL = "pyrender"
"""Rows of the whole body in whole pictures are compared with it."""


@dataclass(frozen=True)
class Row:
    """One measured figure."""

    name: str
    """Case, number of cameras, and batch if it is not 1: with the backend, no other row has it."""
    case: str
    """Size, window and method, as in the paper."""
    backend: str
    value: float
    unit: str
    batch: int
    """Poses a call."""
    cameras: int
    size_px: tuple[int, int]
    """Width and height of a camera's picture."""
    paper: float | None
    """The paper's figure on its GeForce3, in table 1."""


def measure(candidates: Candidates, setup: Setup, repeats: int) -> Iterator[list[Row]]:
    """Measure the rows of a set-up, case by case."""
    scene = Scene(setup)
    candidates.enter(scene)
    for case in scene.cases():
        runners = candidates.runners(case)
        rates = median_rates(runners, repeats)
        candidates.drop_fallen()
        yield [
            _row(case, setup, runner.backend, runner.batch, rate)
            for runner, rate in zip(runners, rates, strict=True)
            if runner.backend in candidates.names
        ]


def _row(case: Case, setup: Setup, backend: str, batch: int, rate: float) -> Row:
    by = f", batches of {batch}" if batch > 1 else ""
    return Row(
        name=f"{case.name}, {setup.n_cameras} cameras{by}",
        case=case.name,
        backend=backend,
        value=round(rate, 1),
        unit="evaluations/s",
        batch=batch,
        cameras=setup.n_cameras,
        size_px=(setup.width_px, setup.height_px),
        paper=case.paper,
    )


def as_table(setup: Setup, rows: Sequence[Row]) -> Table:
    """The rows of one set-up: a line a window, a column a backend."""
    backends = list(dict.fromkeys(row.backend for row in rows))
    has_paper = any(row.paper for row in rows)
    table = Table(
        title=f"Evaluations/s, {setup}",
        caption="one pose at a time, and below by the best batch; times pyrender: the better of both",
    )
    table.add_column("window")
    for column in [*(["GeForce3, 2003"] if has_paper else []), *backends]:
        table.add_column(column, justify="right")
    for name in dict.fromkeys(row.case for row in rows):
        of_case = [row for row in rows if row.case == name]
        papers = [f"{of_case[0].paper or ''}"] if has_paper else []
        table.add_row(name, *papers, *(_cell(of_case, backend) for backend in backends))
        if ratios := _ratios(of_case, backends):
            table.add_row(f"  times {RIVAL}", *([""] if has_paper else []), *ratios, style="dim")
    return table


def _cell(rows: Sequence[Row], backend: str) -> str:
    """One pose at a time, and below it the best batch if that is larger."""
    mine = {row.batch: row.value for row in rows if row.backend == backend}
    return "\n".join(
        f"{value:,.0f}" + (f" by {batch}" if batch > 1 else "")
        for batch, value in mine.items()
        if batch == 1 or value > mine[1]
    )


def _ratios(rows: Sequence[Row], backends: Sequence[str]) -> list[str]:
    """Each backend's best figure over the rival's; nothing where the rival took no part."""
    best = {
        backend: max((r.value for r in rows if r.backend == backend), default=0.0) for backend in backends
    }
    if not best.get(RIVAL):
        return []
    return [f"{best[backend] / best[RIVAL]:.3g}" if best[backend] else "" for backend in backends]
