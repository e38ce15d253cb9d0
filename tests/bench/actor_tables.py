"""The tables of `scripts/bench actors`."""

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from bench.actors import BONE_PERCENT, BONES, HEADING_DEG, HEIGHT_CM, Found, Row
from bench.random_bodies import Variety
from services.mocap.body.skeleton import TRUNK


def as_tables(rows: Sequence[Row]) -> list[Table]:
    """Person by person, then bone by bone, then what was asked for; from the first frames, then refined."""
    of_variety = [[row for row in rows if row.variety is variety] for variety in Variety]
    return [_people(rows), *(table for some in of_variety if some for table in _sums(some))]


def _people(rows: Sequence[Row]) -> Table:
    table = Table(title="People found from their silhouettes")
    for column in ("person", "first frames", "height m"):
        table.add_column(column)
    columns = ("off by cm", "worst bone", "off by %", "joints mm", "IoU", "s")
    for column in (*columns, "heading off by"):
        table.add_column(column, justify="right")
    for row in rows:
        who = f"{row.variety} {row.number}, {row.sex}", row.stance, f"{row.height_m:.2f}"
        table.add_row(*who, *_cells(row.first), f"{row.heading_deg:+.0f}°")
        if row.refined:
            table.add_row("", f"then {row.motion}", "", *_cells(row.refined))
    return table


def _cells(found: Found) -> tuple[str, ...]:
    return (
        f"{found.height_cm:+.1f}", found.worst_bone.replace("_", " "),
        f"{found.bones_percent[found.worst_bone]:+.1f}", f"{found.joints_mm:.0f}", f"{found.iou:.3f}",
        f"{found.seconds:.0f}",
    )  # fmt: skip


def _sums(rows: Sequence[Row]) -> list[Table]:
    """Of one variety of people."""
    fits = {"from the first frames": [row.first for row in rows]}
    if refined := [row.refined for row in rows if row.refined]:
        fits["after refine"] = refined
    tables = [_bones(f"Errors in %, {rows[0].variety}, {way}", found) for way, found in fits.items()]
    asked = Table(title=f"As asked for, {rows[0].variety}")
    asked.add_column("what")
    for way in fits:
        asked.add_column(way, justify="right")
    for what, held in (
        (f"height within {HEIGHT_CM:g} cm", lambda found: abs(found.height_cm) <= HEIGHT_CM),
        (f"height, and all bones within {BONE_PERCENT:g} %", lambda found: found.is_right),
    ):
        asked.add_row(what, *(f"{sum(map(held, found))} of {len(found)}" for found in fits.values()))
    facing = sum(row.faces_right for row in rows)
    asked.add_row(f"heading within {HEADING_DEG:g} degrees", f"{facing} of {len(rows)}")
    return [*tables, asked]


def _bones(title: str, fits: Sequence[Found]) -> Table:
    table = Table(title=title, caption="pelvis and torso do not count: the trunk does")
    for column in ("bone", "median", "95th percentile", "largest", "mean with sign"):
        table.add_column(column, justify="left" if column == "bone" else "right")
    for bone in (*BONES, *TRUNK):
        errors = np.array([found.bones_percent[bone] for found in fits])
        figures = (*np.percentile(np.abs(errors), [50, 95, 100]), errors.mean())
        table.add_row(bone.replace("_", " "), *(f"{figure:.1f}" for figure in figures))
    return table
