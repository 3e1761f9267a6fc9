"""Runs a decoder of images in a process of its own, which may crash without harm.

Crafted files have made decoders of image libraries write beyond their memory. The decoder limits
its own memory, and what it writes.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence

from rhytid.errors import StorageError
from rhytid.formats.exr_decoder import READY
from rhytid.support.temporary_folders import temporary_folder

# Bytes of its messages that are kept, beside its answer.
_MOST_WORDS = 4000


def answer_of(code: str, data: bytes, arguments: Sequence[str], seconds: float, kind: str) -> bytes:
    """What a decoder writes after READY on standard output; empty where it fails.

    code: what Python runs; its arguments are the path of the image, `arguments`, and the places
    that this process imports from.  kind: of the image, for messages. Isolated from the environment
    and the working folder. Raises TimeoutExpired after `seconds`, StorageError where the image
    cannot be written aside, RuntimeError where the decoder does not start.
    """
    try:
        with temporary_folder("rhytid-") as folder:
            path = folder / "image"
            path.write_bytes(data)
            command = [sys.executable, "-I", "-c", code, str(path), *arguments, *sys.path]
            # Into files, whose size the decoder limits for itself: a pipe is read without end.
            answer, said = (folder / name for name in ("answer", "said"))
            with answer.open("wb") as out, said.open("wb") as err:
                child = subprocess.run(
                    command, stdout=out, stderr=err, timeout=seconds, check=False
                )
            found, words = answer.read_bytes(), said.read_bytes()[-_MOST_WORDS:]
    except OSError as exc:
        raise StorageError(f"cannot hand an image to its {kind} decoder: {exc}") from exc
    if not found.startswith(READY):  # an installation that is broken, not the image
        raise RuntimeError(f"the {kind} decoder does not start: {words.decode(errors='replace')}")
    return found[len(READY) :] if child.returncode == 0 else b""
