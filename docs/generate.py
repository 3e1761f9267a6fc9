"""Writes the pages of docs/reference from the code: `python docs/generate.py`.

The pages are committed, so that they can be read without building the site; a test compares them
with the code. Of the page of the settings only the table is written.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from itertools import takewhile
from pathlib import Path
from typing import Any, cast

from rhytid.api.access import ROUTES
from rhytid.api.app import create_app
from rhytid.api.documentation import SCHEME, TAGS
from rhytid.api.live.wire import CLOSE_CODES
from rhytid.api.problems import KINDS
from rhytid.cli.program import build_parser
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.setting_fields import UNBOUNDED, Setting, settings_of
from rhytid.domain.settings_changes import CHANGEABLE
from rhytid.support.settings import ServiceSettings

FOLDER = Path(__file__).parent / "reference"
HEADER = "| setting | default | range | meaning |\n|---|---|---|---|\n"
# Options of every command, by what argparse calls them.
COMMON = ("help", "quiet", "verbose")
# Bodies that are components of the document.
REFERRED = {
    "SettingsChange": "settings to change: " + ", ".join(f"`{name}`" for name in CHANGEABLE)
}
# Pages that say more of a setting.
MORE = {
    "graph.lines": "../lines.md",
    "graph.age": "../skin.md#what-age-does",
    "shape.grain": "../skin.md",
}
NOTE = "<!-- Written by docs/generate.py: change the code, then run it again. -->\n"


def main() -> None:
    """Write every page."""
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")


def pages() -> dict[Path, str]:
    """The text of every page, by its path."""
    settings = FOLDER / "settings.md"
    return {
        settings: with_settings(settings.read_text(encoding="utf-8")),
        FOLDER / "cli.md": cli_page(),
        FOLDER / "http.md": http_page(),
    }


def with_settings(text: str) -> str:
    """The page of the settings with its table as the code has it."""
    before, header, after = text.partition(HEADER)
    lines = after.splitlines(keepends=True)
    table = list(takewhile(lambda line: line.startswith("|"), lines))
    rows = [
        f"| `{s.name}` | `{json.dumps(s.default)}` | {range_of(s.rule)} | {meaning_of(s)} |\n"
        for s in settings_of(AssetSettings())
    ]
    return "".join([before, header, *rows, *lines[len(table) :]])


def meaning_of(setting: Setting) -> str:
    """What a setting means, with a link to the page that says more."""
    more = f" ([more]({MORE[setting.name]}))" if setting.name in MORE else ""
    return _cell(setting.meaning) + more


def range_of(rule: Mapping[str, Any]) -> str:
    """What a setting may be, in words; its default shows whether it may be null."""
    if "options" in rule:
        return ", ".join(f"`{json.dumps(o)}`" for o in rule["options"] if o is not None)
    if "longest" in rule:
        return f"1 to {rule['longest']} characters"
    low, high = rule["low"], rule["high"]
    if high >= UNBOUNDED:
        return "above 0" if low > 0 else "0 or more"
    if rule["whole"]:
        return f"{low} to {high}, {'a power of two' if rule.get('power') else 'whole'}"
    return f"{low:.4g} to {high:g}"


def cli_page() -> str:
    """Every command with its arguments."""
    text = (
        f"{NOTE}\n# Command line\n\n"
        "Every command has `--help` with an example; `-q`, `--quiet`, which leaves results,\n"
        "warnings and errors alone; and `-v`, `--verbose`, which also names steps and written\n"
        "files. Options are written in full. `rhytid --version` prints the version. The exit\n"
        "status is 0 where all was done, 1 after an error, 2 over arguments that cannot be\n"
        "understood, either with one line on stderr, 130 when interrupted and 143 when\n"
        "terminated by SIGTERM; `rhytid serve` ends with 0 then, [once it has\n"
        "drained](../operate.md#shutting-down).\n"
    )
    return text + "".join(_command(name, parser) for name, parser in commands().items())


def commands() -> dict[str, argparse.ArgumentParser]:
    """The parser of each command."""
    actions = build_parser()._actions
    found = next(a for a in actions if isinstance(a, argparse._SubParsersAction))
    return dict(sorted(found.choices.items()))


def _command(name: str, parser: argparse.ArgumentParser) -> str:
    example, _, other = (parser.epilog or "").removeprefix("example: ").partition(", or with: ")
    table = "".join(_group(parser, group) for group in _groups(parser))
    also = f"\nOr with `{other}`.\n" if other else ""
    about = _plain(parser.description or "")
    return f"\n## rhytid {name}\n\n{about}\n{table}\n```sh\n{example}\n```\n{also}"


def _groups(parser: argparse.ArgumentParser) -> list[tuple[str, list[argparse.Action]]]:
    """What --help shows apart, each with its title; arguments and options that are in no group of
    the command's have none."""
    usual = (parser._positionals, parser._optionals)
    own = [action for group in usual for action in group._group_actions]
    plain = [action for action in parser._actions if action in own]
    others = [g for g in parser._action_groups if g not in usual]
    return [("", plain), *((str(g.title).capitalize(), g._group_actions) for g in others)]


def _group(parser: argparse.ArgumentParser, group: tuple[str, list[argparse.Action]]) -> str:
    formatter, (title, actions) = parser._get_formatter(), group
    rows = []
    for action in actions:
        if action.dest not in COMMON:
            meaning = formatter._expand_help(action) if action.help else ""
            rows.append(f"| {_argument(action, formatter)} | {_plain(_cell(meaning))} |\n")
    heading = f"\n**{title}**\n" if title else ""
    return f"{heading}\n| argument | meaning |\n|---|---|\n{''.join(rows)}" if rows else ""


def _argument(action: argparse.Action, formatter: argparse.HelpFormatter) -> str:
    metavar = formatter._get_default_metavar_for_optional(action)
    value = "" if action.nargs == 0 else formatter._format_args(action, metavar)
    # No pipe inside a code span of a table: the site shows its escape.
    return f"`{' '.join([*action.option_strings, value.replace('|', ' or ')]).strip()}`"


def http_page() -> str:
    """Every call with its parameters, its body and its answers, and the table of problems."""
    document = create_app(cast(Any, None), ServiceSettings()).openapi()
    text = (
        f"{NOTE}\n# HTTP\n\n"
        "`/docs` on a running server describes the same, and `/openapi.json` is the document.\n"
        "`/` leads to both. Numbers in the path are whole numbers from 0 up. Where the server\n"
        "asks for [keys](../pipelines.md#access), a call needs a key with its scope.\n"
    )
    for tag in TAGS:
        text += f"\n## {tag['name'].capitalize()}\n\n{tag['description']}\n"
        for path, calls in document["paths"].items():
            for method, call in calls.items():
                if tag["name"] in call["tags"]:
                    text += _call(method, path, call)
    return text + _live() + _problems()


def _call(method: str, path: str, call: Mapping[str, Any]) -> str:
    text = f"\n### {method.upper()} {path}\n\n`{call['operationId']}`: {call['description']}\n"
    scopes = [scope for needed in call.get("security", []) for scope in needed[SCHEME]]
    text += f"\nScope: {', '.join(f'`{scope}`' for scope in scopes) or 'none, it is open'}.\n"
    query = [p for p in call.get("parameters", []) if p["in"] != "path"]
    if query:
        text += "\n| query | values | default | meaning |\n|---|---|---|---|\n"
        text += "".join(_parameter(parameter) for parameter in query)
    for media_type, content in call.get("requestBody", {}).get("content", {}).items():
        text += f"\nBody: `{media_type}`{_body(content['schema'])}\n"
    statuses = ", ".join(_status(status, told) for status, told in call["responses"].items())
    return f"{text}\nAnswers: {statuses}.\n"


def _parameter(parameter: Mapping[str, Any]) -> str:
    schema = parameter["schema"]
    usual = schema.get("default")
    default = "none" if usual is None else f"`{json.dumps(usual)}`"
    if parameter.get("required"):
        default = "required"
    meaning = _cell(parameter.get("description", ""))
    return f"| `{parameter['name']}` | {_values(schema)} | {default} | {meaning} |\n"


def _values(schema: Mapping[str, Any]) -> str:
    if "anyOf" in schema:
        return _values(schema["anyOf"][0])
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if schema.get("type") == "array":
        return _values(schema["items"])
    return str(schema.get("type", ""))


def _body(schema: Mapping[str, Any]) -> str:
    if "$ref" in schema:
        return f", {REFERRED[schema['$ref'].rpartition('/')[2]]}"
    if "properties" not in schema:
        return f", {schema['description']}" if "description" in schema else ""
    parts = schema["properties"].items()
    rows = [f"| `{name}` | {_cell(part.get('description', ''))} |\n" for name, part in parts]
    return "\n\n| part | meaning |\n|---|---|\n" + "".join(rows).rstrip("\n")


def _status(status: str, told: Mapping[str, Any]) -> str:
    kinds = [f"`{kind}`" for kind in told.get("content", {}) if status.startswith("2")]
    return f"{status} ({', '.join(kinds)})" if kinds else status


def _live() -> str:
    """The WebSocket, which the OpenAPI document cannot hold, and its codes."""
    (call, scope), *others = ((c, s) for c, s in ROUTES.items() if c.startswith("WS "))
    assert not others
    rows = "".join(f"| {code} | {_cell(meaning)} |\n" for code, meaning in CLOSE_CODES.items())
    return (
        f"\n## Live\n\n### {call}\n\nA WebSocket, frames in and tiles out: "
        f"[its messages](../live.md).\n\nScope: `{scope}`.\n\n"
        "Before it is open it is refused with 401, 403, 404, 409, 422, 429 or 503. It is closed\n"
        f"with a code, and the reason in words:\n\n| code | reason |\n|---|---|\n{rows}"
    )


def _problems() -> str:
    text = (
        "\n## Problems\n\nErrors are `application/problem+json` (RFC 9457) with `type`, `title`,\n"
        "`status` and `detail`; the detail says what is wrong and where.\n\n"
        "| status | type | title |\n|---|---|---|\n"
    )
    rows = sorted({(kind.status, kind.type, kind.title) for kind in KINDS.values()})
    return text + "".join(f"| {s} | `{type}` | {title} |\n" for s, type, title in rows)


def _plain(text: str) -> str:
    """Text that is not taken for HTML."""
    return text.replace("<", "&lt;")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    main()
