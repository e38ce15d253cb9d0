"""Tables of comma-separated values as named columns of text."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path

import numpy as np

from services.mocap.atomic import atomic_file
from services.mocap.errors import TakeError, in_short, nearest
from services.mocap.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Columns:
    """The content of a file."""

    path: Path
    cells: dict[str, tuple[str, ...]]
    """(N,) cells by column, in the file's order; N >= 1."""
    lines: list[int]
    """(N,) the line that each row is on."""

    def numbers(self, name: str, *, blanks: bool = False, most: float = np.inf) -> Floats:
        """A column (N,) as finite numbers; blanks: empty cells are allowed and become NaN.

        most: where it is finite, numbers are from 0 to it. Raises TakeError.
        """
        values = np.array(
            [
                np.nan if blanks and not cell.strip() else self._number(name, line, cell)
                for line, cell in zip(self.lines, self.cells[name], strict=True)
            ]
        )
        outside = (values < 0) | (values > most)  # false for NaN
        if np.isfinite(most) and outside.any():
            row = int(outside.argmax())
            raise self.error(name, self.lines[row], f"a number from 0 to {most:g}", self.cells[name][row])
        return values

    def error(self, name: str, line: int, expected: str, found: str) -> TakeError:
        """The error for a cell."""
        return TakeError(f"{self.path}: line {line}: {name}: expected {expected}, found {in_short(found)}")

    def _number(self, name: str, line: int, cell: str) -> float:
        try:
            value = float(cell)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise self.error(name, line, "a finite number", cell)
        return value


def as_cells(name: str, values: Floats, digits: str, *, blanks: bool = False) -> list[str]:
    """Numbers (N,) as cells in a format such as ".5f"; raises ValueError where one is not finite.

    blanks: NaN is allowed and becomes an empty cell.
    """
    if not np.all(np.isfinite(values) | (np.isnan(values) & blanks)):
        raise ValueError(f"{name}: expected finite numbers")
    return ["" if isnan(value) else format(value, digits) for value in values.tolist()]


def frame_cells(frames: Ints, time_column: str, times_s: Floats) -> dict[str, list[str]]:
    """The first two columns of a table of frames (N,)."""
    return {"frame": [str(frame) for frame in frames], time_column: as_cells(time_column, times_s, ".6f")}


def write_columns(path: Path, columns: Mapping[str, Sequence[str]]) -> None:
    """Write columns (N,) of cells, completely or not at all."""
    with atomic_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def read_columns(path: Path, required: Sequence[str], *, allow_extra: bool) -> Columns:
    """Raises TakeError for a missing file, missing, unknown or repeated columns, and for no rows."""
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = next(reader, [])
            _check_header(path, header, required, allow_extra=allow_extra)
            for cells in filter(None, reader):
                if len(cells) != len(header):
                    expected = f"expected {len(header)} values as in the header, found {len(cells)}"
                    raise TakeError(f"{path}: line {reader.line_num}: {expected}")
                rows.append(cells)
                lines.append(reader.line_num)
    except FileNotFoundError:
        raise TakeError(f"{path}: is missing: expected a table of comma-separated values") from None
    except (OSError, UnicodeDecodeError, csv.Error):
        raise TakeError(f"{path}: cannot be read: expected a table of comma-separated values") from None
    if not rows:
        raise TakeError(f"{path}: contains no rows: expected one for every frame")
    return Columns(path, dict(zip(header, zip(*rows, strict=True), strict=True)), lines)


def _check_header(path: Path, header: list[str], required: Sequence[str], *, allow_extra: bool) -> None:
    unknown = [name for name in header if name not in required]
    missing = [name for name in required if name not in header]
    if unknown and not allow_extra:
        raise TakeError(
            f"{path}: {in_short(unknown[0])}: unknown column: {nearest(unknown[0], missing or required)}"
        )
    if missing:
        raise TakeError(
            f"{path}: {missing[0]}: column is missing: expected {len(required)} columns "
            f"from {required[0]} to {required[-1]}"
        )
    if len(set(header)) < len(header):
        twice = next(name for name in header if header.count(name) > 1)
        raise TakeError(f"{path}: {in_short(twice)}: duplicate column: expected every column once")
