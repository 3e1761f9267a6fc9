"""What the tests of the documents stand on."""

from __future__ import annotations

import pytest

from house.markdown import Command, bare, commands, shell_lines, table

TEXT = r"""
# Title

rhytid runs; `rhytid serve --port 0` serves, and `rhytid` alone is no command.

```sh
# a comment
python3 -m venv v && v/bin/pip install 'rhytid[cpu]' && v/bin/rhytid demo --out d && rhytid devices
```

## Settings

Prose.

| setting | default | meaning |
|---|---|---|
| `a.b` | `1` | first |
| `c` | `"x\|y"` | second |

| other | table |
|---|---|
| z | y |

## Empty
"""


def test_shell_lines_leave_comments_out() -> None:
    assert len(shell_lines(TEXT)) == 1


def test_commands_come_from_code_alone() -> None:
    assert commands(TEXT) == [
        Command("demo", ("--out",)),
        Command("devices", ()),
        Command("serve", ("--port",)),
    ]


def test_a_command_goes_on_in_the_next_line() -> None:
    found = commands("```sh\nrhytid demo --out d \\\n    --json\nrhytid devices\n```\n")
    assert found == [Command("demo", ("--out", "--json")), Command("devices", ())]


def test_a_table_is_found_by_its_heading() -> None:
    rows = table(TEXT, "Settings")

    assert [bare(row["setting"]) for row in rows] == ["a.b", "c"]
    assert rows[1] == {"setting": "`c`", "default": '`"x\\|y"`', "meaning": "second"}


@pytest.mark.parametrize("heading", ["Empty", "Title", "None"])
def test_a_missing_table_is_an_error(heading: str) -> None:
    with pytest.raises(AssertionError, match=heading):
        table(TEXT, heading)
