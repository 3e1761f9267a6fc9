"""The parts of a Markdown text that can be checked: blocks of code, tables, commands."""

from __future__ import annotations

import re
from typing import NamedTuple

_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_SPAN = re.compile(r"`([^`\n]+)`")
_HEADING = re.compile(r"^#+ +(.+?) *$")
# The program is a word of its own, or the last part of a path; a word after it is its command.
_COMMAND = re.compile(r"(?:^|[\s/])rhytid +([a-z]+)((?: +[^\s&|;]+)*)", re.MULTILINE)
# A pipe inside a cell is escaped.
_BETWEEN = re.compile(r"(?<!\\)\|")
_OPTION = re.compile(r"--[a-z][a-z-]*")


class Command(NamedTuple):
    """A use of the command line: `rhytid NAME --option …`."""

    name: str
    options: tuple[str, ...]


def blocks(text: str, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return [body for kind, body in _FENCE.findall(text) if kind == language]


def shell_lines(text: str) -> list[str]:
    """The lines of the `sh` blocks, of which one that ends with a backslash goes on in the next;
    empty ones and comments left out."""
    whole = (block.replace("\\\n", " ") for block in blocks(text, "sh"))
    lines = [line.strip() for block in whole for line in block.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def commands(text: str) -> list[Command]:
    """Every use of the command line in `sh` blocks and in code spans, not in prose."""
    spans = _SPAN.findall(_FENCE.sub("", text))
    code = "\n".join([*shell_lines(text), *spans])
    return [Command(name, tuple(_OPTION.findall(rest))) for name, rest in _COMMAND.findall(code)]


def table(text: str, heading: str) -> list[dict[str, str]]:
    """The rows of the first table under a heading, by the names of its columns."""
    rows: list[list[str]] = []
    inside = False
    for line in _FENCE.sub("", text).splitlines():
        if title := _HEADING.match(line):
            if rows:
                break
            inside = title[1] == heading
        elif inside and line.startswith("|"):
            rows.append([cell.strip() for cell in _BETWEEN.split(line.strip().strip("|"))])
        elif rows:
            break
    if not rows:
        raise AssertionError(f"no table under a heading {heading!r}")
    header, _, *body = rows
    return [dict(zip(header, row, strict=True)) for row in body]


def bare(cell: str) -> str:
    """A cell without its code marks."""
    return cell.strip("`")
