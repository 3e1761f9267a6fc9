"""What the build writes into packages."""

from __future__ import annotations

import re
import runpy
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from house.pages import PAGES
from house.syntax import ROOT

BUILD = runpy.run_path(str(ROOT / "hatch_build.py"))
index_page = cast("Callable[[str, str, str], str]", BUILD["index_page"])
git_revision = cast("Callable[[Path], str]", BUILD["git_revision"])
_RELATIVE = re.compile(r"\]\((?!https?://|#)")


def test_an_index_gets_no_link_that_leads_nowhere() -> None:
    page = index_page(PAGES["README.md"], "", "main")
    assert "For artists" in page
    assert "contact_sheet.jpg" not in page
    assert not _RELATIVE.search(page)


def test_links_and_pictures_lead_to_the_repository() -> None:
    page = index_page(PAGES["README.md"], "https://example.org/rhytid", "abc")
    assert "](https://example.org/rhytid/blob/abc/docs/artists.md)" in page
    assert "](https://example.org/rhytid/raw/abc/docs/images/skin.jpg)" in page
    assert not _RELATIVE.search(page)


def test_the_revision_is_that_of_the_repository_itself(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        who = ("-c", "user.name=a", "-c", "user.email=a@example.org")
        subprocess.run(["git", "-C", str(tmp_path), *who, *arguments], check=True, timeout=60)

    assert git_revision(tmp_path) == ""
    git("init", "-q")
    (tmp_path / "file").write_text("a")
    git("add", "file")
    git("commit", "-q", "-m", "first")
    clean = git_revision(tmp_path)
    assert re.fullmatch(r"[0-9a-f]{12}", clean)
    (tmp_path / "file").write_text("b")
    assert git_revision(tmp_path) == f"{clean}-dirty"
    (tmp_path / "inside").mkdir()
    assert git_revision(tmp_path / "inside") == "", "of a folder in another repository"


@pytest.mark.parametrize("variable", ["RHYTID_REVISION", "RHYTID_REPOSITORY"])
def test_variables_of_the_build_are_documented(variable: str) -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text() + (ROOT / "docker/Dockerfile").read_text()
    assert variable in text


def test_both_packages_have_one_version_and_one_licence() -> None:
    def text(path: str) -> str:
        return (ROOT / path).read_text(encoding="utf-8")

    found: list[Any] = [
        re.search(r'^__version__ = "(.+)"$', text(path), re.MULTILINE)
        for path in ("service/rhytid/__init__.py", "clients/python/rhytid_client/__init__.py")
    ]
    assert found[0][1] == found[1][1]
    major, minor = found[0][1].split(".")[:2]
    assert f"rhytid-client>={major}.{minor},<{major}.{int(minor) + 1}" in text("pyproject.toml")
    assert text("LICENSE") == text("clients/python/LICENSE")
