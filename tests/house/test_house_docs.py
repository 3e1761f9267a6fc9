"""The pages lead where they say, and name what there is."""

from __future__ import annotations

import json
import re
from pathlib import PurePosixPath

import pytest

from house.markdown import Command, blocks, commands
from house.pages import PAGES, understood
from house.syntax import ROOT
from rhytid.domain.asset_settings import AssetSettings

EXAMPLES = PAGES["docs/examples.md"]
_FENCE = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_CODE = ("service", "cl_kernels", "clients", "tests", "docs")
_FILE = re.compile(r"`((?:\w+/)*\w+\.(?:py|clh?))`")
_METHOD = re.compile(r"`([A-Z][a-z]\w+)\.(\w+)`")
_NAV = re.compile(r"^ +- (?:[^:\n]+: )?(\S+\.md)$", re.MULTILINE)


def test_commands_exist_with_their_options() -> None:
    used = {page: commands(text) for page, text in PAGES.items()}
    names = {command.name for found in used.values() for command in found}

    assert names >= {"demo", "serve", "devices", "synthesize", "bake"}
    wrong = [(page, c) for page, found in used.items() for c in found if not understood(c)]
    assert wrong == []


def test_an_unknown_option_would_be_seen() -> None:
    assert understood(Command("demo", ("--out",)))
    assert not understood(Command("demo", ("--nothing",)))
    assert not understood(Command("nothing", ()))


def test_settings_of_the_examples_are_understood() -> None:
    (settings,) = blocks(EXAMPLES, "json")
    shown = PAGES["README.md"] + EXAMPLES + PAGES["docs/artists.md"]
    given = [settings, *re.findall(r"'(?:settings=)?(\{.*?\})'", shown)]

    assert len(given) >= 5
    assert [AssetSettings().changed(json.loads(one)) for one in given]


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    links = _LINK.findall(_FENCE.sub("", PAGES[page]))
    inside = [link for link in links if "://" not in link]

    assert [link for link in inside if not leads(page, link)] == []


def leads(page: str, link: str) -> bool:
    """Whether a link of a page leads to a file, and to a heading where it names one."""
    target, _, anchor = link.partition("#")
    path = (ROOT / PurePosixPath(page).parent / target).resolve() if target else ROOT / page
    if not path.is_file():
        return False
    name = path.relative_to(ROOT).as_posix()
    return not anchor or (name in PAGES and anchor in anchors(PAGES[name]))


def anchors(text: str) -> set[str]:
    """Of the headings of a page, as GitHub and the site make them."""
    titles = re.findall(r"^#+ +(.+?) *$", _FENCE.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


def test_a_link_to_nothing_would_be_seen() -> None:
    assert leads("README.md", "docs/skin.md#what-age-does")
    assert not leads("README.md", "docs/skin.md#nothing")
    assert not leads("README.md", "docs/nothing.md")
    assert not leads("docs/index.md", "docs/skin.md")


def test_the_navigation_has_every_page() -> None:
    named = _NAV.findall((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    pages = {page.removeprefix("docs/") for page in PAGES if page.startswith("docs/")}

    assert sorted(named) == sorted(pages)


def test_files_of_the_architecture_exist() -> None:
    known = [
        f"/{file.relative_to(ROOT)}" for folder in _CODE for file in (ROOT / folder).rglob("*")
    ]
    named = _FILE.findall(PAGES["docs/maintainers.md"])

    assert len(named) > 30
    assert [name for name in named if not any(file.endswith(f"/{name}") for file in known)] == []


def test_methods_of_the_architecture_exist() -> None:
    sources = "".join(file.read_text("utf-8") for file in (ROOT / "service").rglob("*.py"))
    named = _METHOD.findall(PAGES["docs/maintainers.md"])

    assert len(named) > 5
    wrong = [(c, m) for c, m in named if f"class {c}" not in sources or f"def {m}(" not in sources]
    assert wrong == []
