"""The files by which the services are deployed, as far as they can be checked without an engine."""

import re
from pathlib import Path
from typing import Any

import kubernetes_validate as kubernetes
import pytest
import yaml

_DOCKER = Path(__file__).resolve().parents[2] / "docker"
_FOLDER = _DOCKER / "kubernetes"
_VERSION = "1.31"


def _documents() -> list[dict[str, Any]]:
    files = sorted(set(_FOLDER.glob("*.yaml")) - {_FOLDER / "kustomization.yaml"})
    return [document for file in files for document in yaml.safe_load_all(file.read_text())]


def _name(document: dict[str, Any]) -> str:
    return f"{document['kind']}-{document['metadata']['name']}"


@pytest.mark.parametrize("document", _documents(), ids=_name)
def test_kubernetes_accepts_it(document: dict[str, Any]) -> None:
    kubernetes.validate(document, _VERSION, strict=True)


def test_the_kustomization_names_every_file() -> None:
    kustomization = yaml.safe_load((_FOLDER / "kustomization.yaml").read_text())
    assert sorted(kustomization["resources"]) == sorted(
        file.name for file in _FOLDER.glob("*.yaml") if file.name != "kustomization.yaml"
    )


def test_no_service_runs_as_root_or_writes_to_its_image() -> None:
    pods = [d["spec"]["template"]["spec"] for d in _documents() if d["kind"] in ("Deployment", "Job")]
    assert len(pods) == 4
    for pod in pods:
        assert pod["securityContext"]["runAsNonRoot"]
        assert all(c["securityContext"]["readOnlyRootFilesystem"] for c in pod["containers"])


def test_every_variable_of_compose_is_told() -> None:
    used = set(re.findall(r"\$\{([A-Z_]+)[:}]", (_DOCKER.parent / "compose.yaml").read_text()))
    told = re.findall(r"^\| `([A-Z_]+)` \|", (_DOCKER / "README.md").read_text(), re.MULTILINE)
    assert sorted(used) == sorted(told)
