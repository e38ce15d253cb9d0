"""The README pages say what the code does, where that can be checked."""

import json
import re
from pathlib import Path

import pytest

from field_docstrings import docstrings_of
from services.mocap.body.skeleton import BODY_DOFS
from services.mocap.export.formats import FORMATS
from services.mocap.motion.angles import ANGLES
from services.mocap.search.lost_probability import LOST_M
from services.mocap.search.part_confidence import LEAST_CONFIDENCE
from services.mocap.search.settings import SearchSettings
from services.mocap.take.quantities import QUANTITIES, Quantity
from services.recorder.run_report import LOST_LIMB_MM

_ROOT = Path(__file__).resolve().parents[1]
_PAGES = sorted(
    page
    for folder in ("", "docker", "proto", "services/*", "services/mocap/*", "tests")
    for page in _ROOT.glob(f"{folder}/*.md" if folder else "*.md")
)


@pytest.fixture(scope="module")
def readme() -> str:
    """All pages, one after another."""
    return "\n".join(page.read_text(encoding="utf-8") for page in _PAGES)


def _anchors(page: Path) -> set[str]:
    """What a link may name on a page: its headings, as GitHub writes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def _settings_table() -> str:
    meanings = docstrings_of(SearchSettings)
    rows = [
        f"| `{name}` | `{json.dumps(default)}` | {meanings[name]} |"
        for name, default in SearchSettings().model_dump().items()
    ]
    return "\n".join(["| setting | default | what |", "| --- | --- | --- |", *rows, ""])


def test_every_search_setting_is_told(readme: str) -> None:
    table = _settings_table()
    assert table in readme, f"a page should read:\n\n{table}"


def test_the_numbers_of_parameters_are_told(readme: str) -> None:
    """And no other: pages that speak of a body's parameters mean one of the two."""
    numbers = {len(BODY_DOFS["anatomical"]), len(BODY_DOFS["paper"])}
    told = re.findall(r"(\d+) (?:pose )?parameters", readme)
    assert {int(number) for number in told} == numbers


def test_every_angle_is_told(readme: str) -> None:
    rows = [f"| `{angle.name}` | {angle.meaning} |" for angle in ANGLES]
    table = "\n".join(["| angle | positive is |", "| --- | --- |", *rows, ""])
    assert table in readme, f"a page should read:\n\n{table}"


def test_every_format_is_told(readme: str) -> None:
    for name, form in FORMATS.items():
        assert f"`{name}`" in readme
        for file in form.files:
            assert f"`{file}`" in readme, file


def test_what_is_lost_and_what_is_doubtful_is_told(readme: str) -> None:
    told = " ".join(readme.split())
    both = f"more than {1000 * LOST_M:g} mm from the reference (in the first four rows {LOST_LIMB_MM:g} mm)"
    assert both in told
    assert told.count(f"none of its joints is more than {100 * LOST_M:g} cm off") == 3
    for sentence in (
        "A limb with a confidence below {} is marked as doubtful",
        "All that is lost above {} comes from",
        "Limbs and head with a confidence below {} are **doubtful**",
    ):
        assert sentence.format(f"{LEAST_CONFIDENCE:g}") in told, sentence


@pytest.mark.parametrize("row", QUANTITIES, ids=lambda row: row.name)
def test_every_column_is_told_with_its_file(row: Quantity) -> None:
    page = (_ROOT / "README.md").read_text(encoding="utf-8")
    (told,) = re.findall(rf"^\| `{row.file}` \| (.*) \|$", page, re.MULTILINE)
    assert f"`{row.column.format('*')}`" in told


@pytest.mark.parametrize("page", _PAGES, ids=lambda page: str(page.relative_to(_ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    assert targets
    for path, _, anchor in (target.partition("#") for target in targets):
        if "://" in path:
            continue
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), path
        assert not anchor or anchor in _anchors(target), f"{path}#{anchor}"
