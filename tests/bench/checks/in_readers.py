"""Runs in a Python with OpenSim and c3d: prints the points of a TRC and of a C3D file as JSON.

`python in_readers.py motion.trc motion.c3d`: by kind the labels, the unit, the rate, the first frame and the
points [frame][point][xyz].
"""

import json
import sys
import warnings
from typing import Any

import c3d
import opensim


def read_trc(path: str) -> dict[str, Any]:
    """What OpenSim reads."""
    table = opensim.TimeSeriesTableVec3(path)
    points = [
        [[row.getElt(0, j).get(k) for k in range(3)] for j in range(table.getNumColumns())]
        for row in (table.getRowAtIndex(n) for n in range(table.getNumRows()))
    ]
    return {
        "labels": list(table.getColumnLabels()),
        "unit": table.getTableMetaDataString("Units"),
        "rate": float(table.getTableMetaDataString("DataRate")),
        "points": points,
    }


def read_c3d(path: str) -> dict[str, Any]:
    """What the package c3d reads."""
    with open(path, "rb") as file:  # noqa: PTH123  (a script of its own)
        warnings.simplefilter("ignore")  # it wonders that there are no analogue channels
        reader = c3d.Reader(file)
        points = [frame[:, :3].tolist() for _, frame, _ in reader.read_frames()]
        return {
            "labels": [label.strip() for label in reader.point_labels],
            "unit": reader.get("POINT:UNITS").string_value.strip(),
            "rate": float(reader.point_rate),
            "points": points,
        }


if __name__ == "__main__":
    opensim.Logger.setLevelString("Off")
    print(json.dumps({"trc": read_trc(sys.argv[1]), "c3d": read_c3d(sys.argv[2])}))  # noqa: T201
