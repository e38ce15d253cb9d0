"""README.md says what the code does, where that can be checked."""

import json
import re
from pathlib import Path

import pytest
from field_docstrings import docstrings_of

from services.mocap.export.formats import FORMATS
from services.mocap.motion.angles import ANGLES
from services.mocap.search.settings import SearchSettings

_README = Path(__file__).resolve().parents[1] / "README.md"


@pytest.fixture(scope="module")
def readme() -> str:
    return _README.read_text(encoding="utf-8")


def _settings_table() -> str:
    meanings = docstrings_of(SearchSettings)
    rows = [
        f"| `{name}` | `{json.dumps(default)}` | {meanings[name]} |"
        for name, default in SearchSettings().model_dump().items()
    ]
    return "\n".join(["| setting | default | what |", "| --- | --- | --- |", *rows, ""])


def test_every_search_setting_is_told(readme: str) -> None:
    table = _settings_table()
    assert table in readme, f"README.md should read:\n\n{table}"


def test_every_angle_is_told(readme: str) -> None:
    rows = [f"| `{angle.name}` | {angle.meaning} |" for angle in ANGLES]
    table = "\n".join(["| angle | positive is |", "| --- | --- |", *rows, ""])
    assert table in readme, f"README.md should read:\n\n{table}"


def test_every_format_is_told(readme: str) -> None:
    for name, form in FORMATS.items():
        assert f"`{name}`" in readme
        for file in form.files:
            assert f"`{file}`" in readme, file


def test_links_lead_somewhere(readme: str) -> None:
    targets = re.findall(r"\]\(([^)#]+)\)", readme)
    assert targets
    for target in targets:
        assert (_README.parent / target).exists(), target
