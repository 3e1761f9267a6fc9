"""Reading server-sent events (WHATWG HTML, section 9.2) from chunks of any size."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_LINE = re.compile(rb"([^\r\n]*)(?:\r\n|\n|\r)")


@dataclass(frozen=True)
class Event:
    """One event: its name ("message" where it has none) and its data."""

    name: str
    data: str


class EventReader:
    """Collects bytes and yields the events that they complete."""

    def __init__(self) -> None:
        self._buffer = b""
        self._after_cr = False
        self._name = ""
        self._data: list[str] = []

    def feed(self, chunk: bytes) -> Iterator[Event]:
        """The events that `chunk` completes."""
        for line in self._lines(chunk):
            if line:
                self._field(line.decode("utf-8", "replace"))
            elif self._data:
                yield Event(self._name or "message", "\n".join(self._data))
                self._name, self._data = "", []
            else:
                self._name = ""

    def _lines(self, chunk: bytes) -> Iterator[bytes]:
        if self._after_cr and chunk:
            chunk = chunk.removeprefix(b"\n")
            self._after_cr = False
        text = self._buffer + chunk
        end = 0
        for match in _LINE.finditer(text):
            end = match.end()
            yield match[1]
        self._buffer = text[end:]
        self._after_cr = self._after_cr or (end == len(text) and text.endswith(b"\r"))

    def _field(self, line: str) -> None:
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "event":
            self._name = value
        elif name == "data":
            self._data.append(value)
