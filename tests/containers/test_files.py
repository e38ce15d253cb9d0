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
    assert len(pods) == 5
    for pod in pods:
        assert pod["securityContext"]["runAsNonRoot"]
        assert all(c["securityContext"]["readOnlyRootFilesystem"] for c in pod["containers"])


def test_every_variable_of_compose_is_told() -> None:
    used = set(re.findall(r"\$\{([A-Z_]+)[:}]", (_DOCKER.parent / "compose.yaml").read_text()))
    told = re.findall(r"^\| `([A-Z_]+)` \|", (_DOCKER / "README.md").read_text(), re.MULTILINE)
    assert sorted(used) == sorted(told)


def test_every_service_is_deployed_everywhere() -> None:
    """But for `prepare`, for which others have commands in README.md."""
    files = {name: yaml.safe_load((_DOCKER / name).read_text()) for name in ("../compose.yaml", "stack.yaml")}
    here = {name for name in files["../compose.yaml"]["services"] if name != "prepare"}
    assert set(files["stack.yaml"]["services"]) == here
    assert {d["metadata"]["name"] for d in _documents() if d["kind"] in ("Deployment", "Job")} == here


def test_workers_are_scaled_by_a_figure_that_exists() -> None:
    scaled = next(d for d in _documents() if d["kind"] == "HorizontalPodAutoscaler")
    metric = scaled["spec"]["metrics"][0]["external"]["metric"]["name"]
    rules = re.search(r"```yaml\n(rules:.*?)```", (_DOCKER / "README.md").read_text(), re.DOTALL)
    assert rules is not None
    (rule,) = yaml.safe_load(rules[1])["rules"]["external"]
    assert rule["name"]["as"] == metric
    family = rule["seriesQuery"].partition("_sum{")[0]
    assert f"`{family}`" in (_DOCKER / "README.md").read_text()  # all figures' table, which a test compares
