"""Grey OpenEXR images: one channel of half or float from 0 to 1, which becomes codes of 16 bits.

0.5 becomes 32768 of 65535: mid grey. The header is checked here, and the OpenEXR library decodes
the rest in a process of its own, `exr_decoder`, which it may crash without harm.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import InputError, StorageError
from rhytid.formats.exr_decoder import READY, Wrong, decode
from rhytid.formats.exr_header import read_sides
from rhytid.support.temporary_folders import temporary_folder

_SECONDS = 60
_begun: Callable[[str], None] | None = None
_MOST_WORDS = 4000  # bytes of what the decoder says beside its answer
# Isolated from the environment and the working folder, and importing from where this process does,
# however the package is installed.
_START = (
    "import sys; sys.path[:] = sys.argv[4:]; from rhytid.formats.exr_decoder import main; main()"
)


def decode_here(begun: Callable[[str], None]) -> None:
    """From now on this process, which may crash without harm and has a limit of its memory, decodes
    images by itself.  begun: is told the name of each before."""
    global _begun
    _begun = begun


def read_grey_exr(data: bytes, name: str) -> NDArray[np.uint16]:
    """(h, w) codes of an OpenEXR image: its values times 65535, rounded; row 0 at the top.

    `name` is for messages. Raises InputError saying what is wrong, LimitError above MOST_SIDE
    texels per side, StorageError where the image cannot be written aside for the decoder. Values
    are taken as they are, whatever the channel is called.
    """
    width, height = read_sides(data, name)
    if _begun is not None:
        _begun(name)
        return _decoded_here(data, name, width, height)
    try:
        answer = _decoded(data, width, height)
    except subprocess.TimeoutExpired as exc:
        raise InputError(f"{name}: not decoded within {_SECONDS} s") from exc
    try:
        wrong = _wrong(answer)
        if wrong is None:
            return np.frombuffer(answer, np.uint16, offset=len(b"null\n")).reshape(height, width)
    except (ValueError, RecursionError) as exc:  # it failed, or was made to answer something else
        raise InputError(f"{name}: a damaged EXR image") from exc
    raise _beyond(wrong, name)


def _beyond(wrong: Wrong, name: str) -> InputError:
    place = f"the texel of column {wrong.column}, row {wrong.row}"
    return InputError(f"{name}: {place} is {wrong.value}: must be from 0 to 1")


def _decoded_here(data: bytes, name: str, width: int, height: int) -> NDArray[np.uint16]:
    with temporary_folder("rhytid-") as folder:
        path = folder / "map.exr"
        path.write_bytes(data)
        try:
            wrong, codes = decode(path, width, height)
        except MemoryError:
            raise
        except Exception as exc:
            raise InputError(f"{name}: a damaged EXR image") from exc
    if wrong is not None:
        raise _beyond(wrong, name)
    return codes


def _wrong(answer: bytes) -> Wrong | None:
    """What the first line of an answer says; raises ValueError where it is something else."""
    found = json.loads(answer[: answer.find(b"\n")])
    if found is None:
        return None
    if not (isinstance(found, list) and [type(part) for part in found] == [int, int, str]):
        raise ValueError("neither null nor a texel")
    return Wrong(*found)


def _decoded(data: bytes, width: int, height: int) -> bytes:
    """What the decoder answers after READY; nothing where it fails."""
    try:
        with temporary_folder("rhytid-") as folder:
            path = folder / "map.exr"
            path.write_bytes(data)
            arguments = [str(path), str(width), str(height), *sys.path]
            command = [sys.executable, "-I", "-c", _START, *arguments]
            # Into files, whose size the decoder limits for itself: a pipe is read without end.
            answer, said = (folder / name for name in ("answer", "said"))
            with answer.open("wb") as out, said.open("wb") as err:
                child = subprocess.run(
                    command, stdout=out, stderr=err, timeout=_SECONDS, check=False
                )
            found, words = answer.read_bytes(), said.read_bytes()[-_MOST_WORDS:]
    except OSError as exc:
        raise StorageError(f"cannot hand an EXR image to its decoder: {exc}") from exc
    if not found.startswith(READY):  # an installation that is broken, not the image
        raise RuntimeError(f"the EXR decoder does not start: {words.decode(errors='replace')}")
    return found[len(READY) :] if child.returncode == 0 else b""
