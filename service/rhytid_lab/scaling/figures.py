"""Measured figures, read from JSON: those of `rhytid bench`, and runs of `rhytid bake`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rhytid.errors import InputError


@dataclass(frozen=True)
class Frame:
    """A frame that `rhytid bench` timed.

    size: texels per side.  seconds: by case.  processor: the same as processor time of the host.
    """

    device: str
    size: int
    wrinkles: int
    seconds: Mapping[str, float]
    processor: Mapping[str, float]

    @property
    def texels(self) -> int:
        """Of one map."""
        return self.size**2


@dataclass(frozen=True)
class Run:
    """Some frames that `rhytid bake` wrote by so many processes side by side.

    wall: seconds from the first start to the last end.  processor: seconds of all processes.
    nbytes: of all files.  steps: seconds by step, summed over the processes, wall time.
    """

    size: int
    wrinkles: int
    method: str
    workers: int
    frames: int
    wall: float
    processor: float
    nbytes: int
    steps: Mapping[str, float]

    @property
    def texels(self) -> int:
        """Of one map."""
        return self.size**2

    @property
    def share(self) -> float:
        """Processor time over wall time of one process, at most 1: the rest it waited, on a
        processor of its own for the disk, on a shared one for others."""
        return min(self.processor / (self.wall * self.workers), 1.0)


def read_frame(file: Path) -> Frame:
    """The figures of `rhytid bench --json FILE`; raises InputError naming the file and what is
    missing or no number."""
    data = _read(file)
    results = _of(data, "results", list, file)
    ours = [row for row in results if row.get("implementation") == "rhytid"]
    seconds, processor = (
        {str(_of(row, "case", str, file)): _of(row, name, float, file) for row in ours}
        for name in ("seconds", "processor_seconds")
    )
    size, wrinkles = (_of(data, name, int, file) for name in ("size", "wrinkles"))
    return Frame(_of(data, "device", str, file), size, wrinkles, seconds, processor)


def read_runs(file: Path) -> list[Run]:
    """The runs of `python -m rhytid_lab.scaling measure --json FILE`; raises InputError as
    `read_frame` does."""
    kinds = Run.__dataclass_fields__
    found = []
    for row in _of(_read(file), "runs", list, file):
        values = {name: _of(row, name, _KINDS[str(kinds[name].type)], file) for name in kinds}
        found.append(Run(**values))
    return found


_KINDS: dict[str, type] = {
    "int": int, "float": float, "str": str, "Mapping[str, float]": dict,
}  # fmt: skip


def _read(file: Path) -> dict[str, Any]:
    try:
        data = json.loads(file.read_bytes())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file} is not JSON: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"{file}: an object was expected")
    return data


def _of(data: Mapping[str, Any], name: str, kind: type, file: Path) -> Any:
    if name not in data:
        raise InputError(f"{file} has no {name!r}")
    value = data[name]
    known = (int, float) if kind is float else (kind,)
    if not isinstance(value, known) or isinstance(value, bool):
        raise InputError(f"{file}: {name!r} is {value!r}, not of kind {kind.__name__}")
    return value


def one_device(frames: Iterable[Frame]) -> str:
    """The device of all frames; raises InputError where there are several, or no frame."""
    names = sorted({frame.device for frame in frames})
    if len(names) != 1:
        raise InputError(f"figures of one device are needed, these are of {names or 'none'}")
    return names[0]
