"""What a caller sent, as the bytes of a file: read again by a replica that goes on with a build."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from rhytid.decoding.words import read_word
from rhytid.engine.messages import NewAsset
from rhytid.engine_process.packing import pack, places_of
from rhytid.errors import SharedDamageError

# Bytes of the pickle, and number of arrays; sizes of the arrays, the pickle and the arrays follow.
_HEAD = struct.Struct("<QQ")


def written_upload(new: NewAsset) -> Iterator[bytes | memoryview]:
    """The bytes of a file."""
    packed = pack(new)
    sizes = [size for _, size in packed.places]
    yield _HEAD.pack(len(packed.body), len(sizes))
    yield struct.pack(f"<{len(sizes)}Q", *sizes)
    yield packed.body
    memory = np.zeros(packed.nbytes, np.uint8)
    packed.write(memory)
    yield memory.data


def read_upload(data: bytes) -> NewAsset:
    """What was written; nothing that the bytes say is run. Raises SharedDamageError where they are
    damaged."""
    try:
        length, count = _HEAD.unpack_from(data)
        start = _HEAD.size + 8 * count
        sizes = struct.unpack_from(f"<{count}Q", data, _HEAD.size)
        memory = np.frombuffer(data, np.uint8)[start + length :].copy()
        found = read_word(data[start : start + length], places_of(sizes), memory)
    except Exception as error:
        raise SharedDamageError(f"an upload that was kept is damaged: {error}") from error
    if not isinstance(found, NewAsset):
        raise SharedDamageError("an upload that was kept is damaged: it is no asset")
    return found
