"""The files of `runtime`, which packages hand out or are made from."""

from __future__ import annotations

from importlib.resources import files


def runtime(name: str) -> str:
    """The text of a file of `runtime`."""
    return (files("rhytid.skin_package") / "runtime" / name).read_text(encoding="utf-8")
