"""The README says what is true, in little room."""

from __future__ import annotations

import re
from importlib.metadata import metadata

import rhytid
import rhytid_client
from house.markdown import shell_lines
from house.pages import PAGES, README
from house.syntax import ROOT

CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 150


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
