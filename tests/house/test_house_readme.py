"""The README says what is true, in little room."""

from __future__ import annotations

import re
from importlib.metadata import metadata

import pytest

import rhytid
import rhytid_client
from house.markdown import shell_lines
from house.pages import PAGES, README
from house.syntax import ROOT

CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 150


@pytest.mark.parametrize(("page", "link"), [("README.md", "docs/"), ("docs/index.md", "")])
def test_a_reader_with_a_mesh_comes_first(page: str, link: str) -> None:
    text = PAGES[page].partition("\n")[2].lstrip()
    first = text.partition(". ")[0]
    assert "mesh" in first
    assert "displacement maps" in first
    assert "HTTP" not in first
    assert re.findall(r"\]\(([^)]+)\)", text)[0] == f"{link}ten_minutes.md"


def test_pages_for_operators_alone_stand_apart() -> None:
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("nav:\n")[2]
    sections = re.split(r"^  - ", nav, flags=re.MULTILINE)[1:]
    found = {part.partition(":")[0]: re.findall(r"\S+\.md", part) for part in sections}
    apart = ["operate.md", "farm.md", "farm_dask.md", "shared-store.md", "fleet.md", "scaling.md"]
    assert found["For operators"][: len(apart)] == apart
    assert list(found).index("For artists") < list(found).index("For operators")


def test_the_test_command_is_what_ci_runs() -> None:
    lines = [line for line in shell_lines(README) if ".venv/bin/pytest -n" in line]

    assert len(lines) == 1
    assert lines[0] in [line.strip() for line in CI.splitlines()]


def test_the_test_command_sets_everything_up() -> None:
    line = next(line for line in shell_lines(README) if ".venv/bin/pytest -n" in line)

    assert "venv" in line
    assert "pip install" in line


def test_one_line_runs_the_demo_from_nothing() -> None:
    lines = [line for line in shell_lines(README) if "rhytid demo" in line and "venv" in line]

    assert lines


def test_named_extras_exist() -> None:
    named = re.findall(r"(?:rhytid|\.)\[([a-z,]+)\]", "".join(PAGES.values()))
    known = metadata("rhytid").get_all("Provides-Extra") or []

    assert named
    assert {extra for group in named for extra in group.split(",")} <= set(known)


def test_the_readme_tells_of_the_patents_before_anything_is_installed() -> None:
    before, _, _ = README.partition("## Does it fit")

    assert "12,651,397" in before
    assert "12,651,397" in PAGES["docs/index.md"]


def test_versions_agree() -> None:
    newest = re.search(r"^## \[?([0-9]+\.[0-9]+\.[0-9]+)", CHANGELOG, re.MULTILINE)

    assert newest is not None
    assert newest[1] == rhytid.__version__ == rhytid_client.__version__
