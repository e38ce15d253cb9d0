"""Characters to be imported."""

from pathlib import Path

import pytest

from characters import PERSON, bind_pose, write_skinned_glb
from services.mocap.body.actor import Body, build_body
from services.mocap.body.own_mesh.mesh_import import Imported, import_mesh


@pytest.fixture(scope="session")
def person() -> Body:
    """Whom the files show."""
    return build_body(PERSON)


@pytest.fixture(scope="session")
def a_pose_glb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("characters") / "a.glb"
    write_skinned_glb(path, PERSON, bind_pose(0.8, 0.15))
    return path


@pytest.fixture(scope="session")
def imported(a_pose_glb: Path) -> Imported:
    return import_mesh(a_pose_glb)
