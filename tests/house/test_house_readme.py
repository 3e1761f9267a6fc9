"""The README says what is true."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import metadata
from typing import Any

import pytest

import rhytid
import rhytid_client
from house.markdown import Command, bare, blocks, commands, shell_lines, table
from house.syntax import ROOT
from rhytid.cli.program import build_parser
from rhytid.domain.asset_settings import AssetSettings
from rhytid.settings import ServiceSettings

README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
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


def test_the_test_command_is_what_ci_runs() -> None:
    lines = [line for line in shell_lines(README) if ".venv/bin/pytest -n" in line]

    assert len(lines) == 1
    assert lines[0] in CI.splitlines()


def test_the_test_command_sets_everything_up() -> None:
    line = next(line for line in shell_lines(README) if ".venv/bin/pytest -n" in line)

    assert "venv" in line
    assert "pip install" in line


def test_one_line_runs_the_demo_from_nothing() -> None:
    lines = [line for line in shell_lines(README) if "rhytid demo" in line and "venv" in line]

    assert lines


def test_named_extras_exist() -> None:
    named = re.findall(r"(?:rhytid|\.)\[([a-z,]+)\]", README)
    known = metadata("rhytid").get_all("Provides-Extra") or []

    assert named
    assert {extra for group in named for extra in group.split(",")} <= set(known)


def test_commands_exist_with_their_options() -> None:
    used = [*commands(README), *commands(EXAMPLES)]

    assert {command.name for command in used} >= {"demo", "serve", "devices", "synthesize", "bake"}
    assert [command for command in used if not understood(command)] == []


def understood(command: Command) -> bool:
    parsers = subparsers()
    if command.name not in parsers:
        return False
    known = {
        option for action in parsers[command.name]._actions for option in action.option_strings
    }
    return set(command.options) <= known


def subparsers() -> dict[str, argparse.ArgumentParser]:
    actions = build_parser()._actions
    found = next(a for a in actions if isinstance(a, argparse._SubParsersAction))
    return dict(found.choices)


def test_an_unknown_option_would_be_seen() -> None:
    assert understood(Command("demo", ("--out",)))
    assert not understood(Command("demo", ("--nothing",)))
    assert not understood(Command("nothing", ()))


def test_settings_table_has_every_default() -> None:
    told = {bare(row["setting"]): bare(row["default"]) for row in table(README, "Settings")}
    true = dict(defaults(AssetSettings()))

    assert set(told) == set(true)
    assert {name: json.loads(value) for name, value in told.items()} == true


def defaults(settings: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every setting by its path, as `bins.count`."""
    for declared in fields(settings):
        value = getattr(settings, declared.name)
        if is_dataclass(value):
            yield from defaults(value, f"{path}{declared.name}.")
        else:
            yield path + declared.name, value


def test_settings_table_has_every_range() -> None:
    told = {bare(row["setting"]): row["range"] for row in table(README, "Settings")}

    assert told == dict(ranges(AssetSettings()))


def ranges(settings: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """What every setting may be, by its path."""
    for declared in fields(settings):
        value = getattr(settings, declared.name)
        if is_dataclass(value):
            yield from ranges(value, f"{path}{declared.name}.")
        else:
            yield path + declared.name, range_of(declared.metadata)


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


# Of every command that reads a mesh: told once, below the table.
SHARED = ("--device", "--strict", "--allow", "--json")


@pytest.mark.parametrize("name", ["bake", "demo", "synthesize", "graph"])
def test_the_row_of_a_command_has_every_option(name: str) -> None:
    row = next(line for line in README.splitlines() if line.startswith(f"| `rhytid {name} "))
    known = {o for action in subparsers()[name]._actions for o in action.option_strings}
    options = known - {"-h", "--help", *SHARED}

    assert {option for option in options if not re.search(rf"{option}(?![a-z-])", row)} == set()
    assert all(f"`{option}" in README for option in SHARED)


def test_settings_of_the_examples_are_understood() -> None:
    (settings,) = blocks(EXAMPLES, "json")
    given = [settings, *re.findall(r"'(?:settings=)?(\{.*?\})'", README + EXAMPLES)]

    assert len(given) >= 5
    assert [AssetSettings().changed(json.loads(one)) for one in given]


def test_environment_table_has_every_variable() -> None:
    environment = Recording()
    usual = ServiceSettings.from_environment(environment)
    rows = table(README, "Environment")
    told = {bare(row["variable"]): bare(row["default"]) for row in rows}

    assert set(told) == set(environment.asked)
    given = {name: value for name, value in told.items() if value not in NOTHING}
    assert ServiceSettings.from_environment(given) == usual


@pytest.mark.parametrize("name", ["setting", "variable"])
def test_every_row_has_a_meaning(name: str) -> None:
    heading = {"setting": "Settings", "variable": "Environment"}[name]

    assert [row for row in table(README, heading) if not row["meaning"]] == []


def test_the_readme_ends_with_the_patents() -> None:
    last = README.strip().split("\n\n")[-1]

    assert "12,651,397" in last


def test_versions_agree() -> None:
    newest = re.search(r"^## \[?([0-9]+\.[0-9]+\.[0-9]+)", CHANGELOG, re.MULTILINE)

    assert newest is not None
    assert newest[1] == rhytid.__version__ == rhytid_client.__version__
