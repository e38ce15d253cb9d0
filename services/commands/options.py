"""Options that several commands take, and what they stand for."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from services.mocap.body.body_mesh import OwnMesh
from services.mocap.body.own_mesh.importing import import_mesh

MeshOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Fit this mesh: a skinned character (.glb) or named parts (.obj, .glb)."),
]
TakeFolder: TypeAlias = Annotated[Path, typer.Argument(help="The take folder.", metavar="TAKE")]


def imported(mesh: Path | None, warnings: list[str]) -> OwnMesh | None:
    """The own mesh of a file, if one was given; adds to the warnings. Raises UserError."""
    if mesh is None:
        return None
    found = import_mesh(mesh)
    warnings += found.remarks
    return found.mesh
