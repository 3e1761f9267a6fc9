"""The pages of docs/reference say what the code does."""

from __future__ import annotations

import json
import re
import runpy
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, cast

import pytest

from house.markdown import bare, table
from house.pages import CLI, HTTP, SETTINGS, options, subparsers
from house.syntax import ROOT
from rhytid.api.app import create_app
from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import SettingsError
from rhytid.support.settings import ServiceSettings

# Cells that stand for "not set".
NOTHING = ("", "-", "–", "—", "none", "not set")


class Recording(dict[str, str]):
    """An environment that remembers which variables were asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[str] = []

    def get(self, key: str, default: Any = None) -> Any:
        self.asked.append(key)
        return super().get(key, default)


def test_the_pages_are_what_the_code_writes() -> None:
    written = runpy.run_path(str(ROOT / "docs" / "generate.py"))["pages"]()

    stale = [path.name for path, text in written.items() if path.read_text("utf-8") != text]
    assert stale == [], "run `python docs/generate.py`"


def test_settings_table_has_every_default() -> None:
    rows = table(SETTINGS, "Table of settings")
    told = {bare(row["setting"]): bare(row["default"]) for row in rows}
    true = {name: value for name, value, _ in settings_of(AssetSettings())}

    assert set(told) == set(true)
    assert {name: json.loads(value) for name, value in told.items()} == true


def test_settings_table_has_every_range() -> None:
    told = {bare(row["setting"]): row["range"] for row in table(SETTINGS, "Table of settings")}

    assert told == {name: range_of(rule) for name, _, rule in settings_of(AssetSettings())}


def settings_of(settings: Any, path: str = "") -> Iterator[tuple[str, Any, Mapping[str, Any]]]:
    """Every setting by its path, as `bins.count`, with its default and its rule."""
    for declared in fields(settings):
        value = getattr(settings, declared.name)
        if is_dataclass(value):
            yield from settings_of(value, f"{path}{declared.name}.")
        else:
            yield path + declared.name, value, declared.metadata


def range_of(rule: Mapping[str, Any]) -> str:
    if "options" in rule:
        return ", ".join(f"`{json.dumps(o)}`" for o in rule["options"] if o is not None)
    if "longest" in rule:
        return f"1 to {rule['longest']} characters"
    low, high = rule["low"], rule["high"]
    if high >= 1e30:
        return "above 0" if low > 0 else "0 or more"
    if rule["whole"]:
        return f"{low} to {high}, {'a power of two' if rule.get('power') else 'whole'}"
    return f"{low:.4g} to {high:g}"


def test_settings_are_refused_beyond_the_ranges_of_the_table() -> None:
    numbers = re.compile(r"(\S+) to ([^\s,]+)(, .*)?$")
    rows = table(SETTINGS, "Table of settings")
    found = [(bare(row["setting"]), numbers.match(row["range"])) for row in rows]
    limits = [(name, *ends.groups()) for name, ends in found if ends is not None]

    assert len(limits) > 30
    for name, low, high, whole in limits:
        beyond = (int(low) - 1, int(high) + 1) if whole else (float(low) - 1e-3, float(high) + 1e-3)
        for wrong in beyond:
            with pytest.raises(SettingsError, match=f"^{re.escape(name)} is .*: from "):
                AssetSettings().changed(nested(name, wrong))


def nested(name: str, value: object) -> object:
    for part in reversed(name.split(".")):
        value = {part: value}
    return value


def test_environment_table_has_every_variable() -> None:
    environment = Recording()
    usual = ServiceSettings.from_environment(environment)
    rows = table(SETTINGS, "Environment")
    told = {bare(row["variable"]): bare(row["default"]) for row in rows}

    assert set(told) == set(environment.asked)
    given = {name: value for name, value in told.items() if value not in NOTHING}
    assert ServiceSettings.from_environment(given) == usual


@pytest.mark.parametrize("heading", ["Table of settings", "Environment"])
def test_every_row_has_a_meaning(heading: str) -> None:
    assert [row for row in table(SETTINGS, heading) if not row["meaning"]] == []


def section(text: str, heading: str) -> str:
    """What stands under a heading, up to the next of its level."""
    found = re.search(
        rf"^{re.escape(heading)}\n(.*?)(?=^{heading.split()[0]} |\Z)", text, re.M | re.S
    )
    assert found is not None, f"no heading {heading!r}"
    return found[1]


# Told once, before the commands.
COMMON = {"-h", "--help", "-q", "--quiet", "-v", "--verbose"}


def test_what_every_command_has_is_told_first() -> None:
    first = CLI.partition("\n## ")[0]
    assert [option for option in COMMON - {"-h"} if f"`{option}`" not in first] == []


@pytest.mark.parametrize("name", subparsers())
def test_a_command_is_told_with_every_option(name: str) -> None:
    told = section(CLI, f"## rhytid {name}")
    known = options(name) - COMMON

    assert {option for option in known if not re.search(rf"`{option}(?![a-z-])", told)} == set()
    assert "```sh\nrhytid " in told


def test_every_argument_has_a_meaning() -> None:
    rows = [row for name in subparsers() for row in arguments(name)]

    assert len(rows) > 50
    assert [row for row in rows if not row["meaning"]] == []


def arguments(name: str) -> list[dict[str, str]]:
    heading = f"rhytid {name}"
    return table(CLI, heading) if "| argument" in section(CLI, f"## {heading}") else []


def test_every_call_is_told_with_its_parameters() -> None:
    paths = create_app(cast(Any, None), ServiceSettings()).openapi()["paths"]
    calls = [(m, path, call) for path, found in paths.items() for m, call in found.items()]

    assert len(calls) > 20
    for method, path, call in calls:
        told = section(HTTP, f"### {method.upper()} {path}")
        query = [p["name"] for p in call.get("parameters", []) if p["in"] == "query"]
        assert [name for name in query if f"| `{name}` |" not in told] == []
        assert [status for status in call["responses"] if status not in told] == []
