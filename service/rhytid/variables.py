"""Environment variables, read as the kind of value that each holds.

Every function raises SettingsError naming the variable. A variable that is empty counts as absent.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Mapping
from pathlib import Path

from rhytid.errors import SettingsError

MIB = 1 << 20
# A name, all names below one, or all. No port: they are allowed with any.
_HOST = re.compile(r"\*|(?:\*\.)?[a-z0-9_-]+(?:\.[a-z0-9_-]+)*")
_ORIGIN = re.compile(r"\*|https?://(?:[a-z0-9._-]+|\[[0-9a-f:.]+\])(?::[0-9]{1,5})?")


class Variables:
    """The variables of a process by name, as they were when it started."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._environment = environment
        # Names that were asked for.
        self.asked: set[str] = set()

    def text(self, name: str) -> str | None:
        """As it is written."""
        self.asked.add(name)
        return self._environment.get(name) or None

    def path(self, name: str) -> Path | None:
        """A file or a folder."""
        given = self.text(name)
        return None if given is None else Path(given)

    def number(self, name: str) -> int | None:
        """A whole number from 1 to 2**40 - 1."""
        value = self.text(name)
        if value is None:
            return None
        if not (value.isascii() and value.isdigit() and 0 < int(value) < 2**40):
            raise SettingsError(f"{name} is {value!r}: must be a whole number above 0")
        return int(value)

    def count(self, name: str, default: int) -> int:
        """As `number`, or the default."""
        return self.number(name) or default

    def mebibytes(self, name: str) -> int | None:
        """Bytes, of a variable in MiB."""
        value = self.number(name)
        return None if value is None else value * MIB

    def choice(self, name: str, choices: tuple[str, ...]) -> str:
        """One of a few words; the first of them where the variable is absent."""
        value = self.text(name) or choices[0]
        if value not in choices:
            raise SettingsError(f"{name} is {value!r}: one of {', '.join(choices)}")
        return value

    def hosts(self, name: str) -> tuple[str, ...]:
        """Names of hosts with commas between, in lower case."""
        return self._several(name, _HOST, "skin.studio.example")

    def origins(self, name: str) -> tuple[str, ...]:
        """Origins of web pages with commas between, in lower case."""
        return self._several(name, _ORIGIN, "http://localhost:5173")

    def networks(self, name: str) -> tuple[str, ...]:
        """Addresses, and networks as 10.0.0.0/8, with commas between."""
        given = [one.strip() for one in (self.text(name) or "").split(",")]
        for one in filter(None, given):
            _check_network(name, one)
        return tuple(filter(None, given))

    def home_folder(self, name: str, default: str) -> Path | None:
        """A folder, in which `~` is the user's home. None where the default is used and there is no
        home."""
        given = self.text(name)
        try:
            return Path(given or default).expanduser()
        except RuntimeError as exc:
            if given:
                raise SettingsError(f"{name} is {given!r}: {exc}") from exc
            return None

    def _several(self, name: str, form: re.Pattern[str], example: str) -> tuple[str, ...]:
        given = [one.strip().lower() for one in (self.text(name) or "").split(",")]
        wrong = [one for one in given if one and not form.fullmatch(one)]
        if wrong:
            raise SettingsError(f"{name} has {wrong[0]!r}: must be like {example}, or *")
        return tuple(one for one in given if one)


def _check_network(name: str, given: str) -> None:
    try:
        ipaddress.ip_network(given)
    except ValueError as exc:
        rule = "must be an address or a network, such as 10.1.2.3 or 10.1.0.0/16"
        raise SettingsError(f"{name} has {given!r}: {rule}") from exc
