"""What a server and a process that decodes tell each other.

The process meets what strangers send, so what it tells is read with care: plain values and our own
facts, nothing that a pickle could run.
"""

from __future__ import annotations

import io
import pickle
from dataclasses import dataclass, is_dataclass
from typing import Any

import numpy as np

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.scan import ScanSettings
from rhytid.errors import RhytidError
from rhytid.processes.packing import Bytes, Places, pack, slices


@dataclass(frozen=True)
class Piece:
    """Where the bytes of a file are in the file of the upload."""

    name: str
    filename: str | None
    start: int
    size: int


@dataclass(frozen=True)
class Job:
    """What is to be decoded, in the order in which it was sent.

    room: bytes of memory.  seconds: of processor time.
    """

    pieces: tuple[Piece, ...]
    settings: AssetSettings
    scan: ScanSettings
    force: bool
    room: int
    seconds: int


@dataclass(frozen=True)
class Promised:
    """Headers promise so many bytes; the process waits until it is told how many it may take."""

    nbytes: int


@dataclass(frozen=True)
class Granted:
    """The process may take so many bytes beside its room."""

    nbytes: int


@dataclass(frozen=True)
class Begun:
    """A file is decoded next."""

    filename: str


@dataclass(frozen=True)
class TooLarge:
    """The upload takes more than `room` bytes of memory."""

    room: int


@dataclass(frozen=True)
class Broken:
    """Something of ours failed; what the log needs to know."""

    trace: str


_NUMPY = {"_frombuffer", "_reconstruct", "ndarray", "dtype", "scalar"}
_OURS = ("rhytid.domain.", "rhytid.processes.decoding.words")
_ALSO = {
    ("rhytid.engine.messages", "NewAsset"),
    ("rhytid.processes.packing", "_read_only"),
}


class _Careful(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """Classes of ours and what arrays are made by; raises UnpicklingError for all else."""
        if "." not in name:
            if (module.partition(".")[0] == "numpy" and name in _NUMPY) or (module, name) in _ALSO:
                return super().find_class(module, name)
            if module.startswith(_OURS) or module == "rhytid.errors":
                found = super().find_class(module, name)
                if _is_ours(found, module):
                    return found
        raise pickle.UnpicklingError(f"{module}.{name} is not expected here")


def _is_ours(found: Any, module: str) -> bool:
    """A fact or an error that the module defines: what it imports, such as operator.attrgetter,
    would lead anywhere."""
    if not isinstance(found, type) or found.__module__ != module:
        return False
    return is_dataclass(found) or issubclass(found, RhytidError)


def read_word(body: bytes, places: Places = (), memory: Bytes | None = None) -> Any:
    """What was told; its large arrays lie in `memory`. Raises UnpicklingError and others where it
    is nothing that is expected."""
    raw = np.empty(0, np.uint8) if memory is None else memory
    return _Careful(io.BytesIO(body), buffers=slices(raw, places)).load()


def written(word: Any) -> bytes:
    """A word without large arrays."""
    return pack(word).body
