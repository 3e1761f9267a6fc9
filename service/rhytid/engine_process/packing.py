"""Plain values as bytes: pickles; the bytes of large arrays lie apart, in memory that two processes
share, and files are named by their descriptors.

Only for messages between a server and the process that it started: a pickle can run any code.
"""

from __future__ import annotations

import copyreg
import ctypes
import io
import mmap
import os
import pickle
import tempfile
import weakref
from collections.abc import Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, partial
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.storage.snapshots import OpenFile, Snapshot

Bytes = NDArray[np.uint8]


def shared_file(nbytes: int) -> int:
    """The descriptor of so many bytes of memory, all zero; its holder closes it."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("rhytid")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    try:
        os.ftruncate(descriptor, nbytes)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def mapped(descriptor: int, nbytes: int) -> Bytes:
    """The bytes of a shared file, as both processes see them; they hold no descriptor."""
    return _mapped(descriptor, nbytes, mmap.MAP_SHARED)


def private(descriptor: int, nbytes: int) -> Bytes:
    """The bytes of a shared file; what is written to them stays here."""
    return _mapped(descriptor, nbytes, mmap.MAP_PRIVATE)


def _mapped(descriptor: int, nbytes: int, flags: int) -> Bytes:
    # Python's own mmap keeps a descriptor for each, and a process has about a thousand.
    protection = mmap.PROT_READ | mmap.PROT_WRITE
    address = _system().mmap(None, nbytes, protection, flags, descriptor, 0)
    if address == ctypes.c_void_p(-1).value:
        raise OSError(ctypes.get_errno(), "shared memory cannot be mapped")
    memory: Any = (ctypes.c_ubyte * nbytes).from_address(address)
    found: Bytes = np.frombuffer(memory, np.uint8)
    weakref.finalize(found, _system().munmap, address, nbytes).atexit = False
    return found


@cache
def _system() -> Any:
    system = ctypes.CDLL(None, use_errno=True)
    system.mmap.restype = ctypes.c_void_p
    numbers = (ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long)
    system.mmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t, *numbers)
    system.munmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t)
    return system


# Bytes from which on those of an array lie apart.
APART = 8192
# Where arrays begin in shared memory.
_STEP = 64


@dataclass
class Packed:
    """A value as a pickle, the bytes of its large arrays, and the descriptors of its files.

    memory: shared memory that the arrays were written to last, None where they were not.
    """

    body: bytes
    arrays: tuple[memoryview, ...]
    files: tuple[int, ...] = ()
    memory: Bytes | None = None

    @property
    def sizes(self) -> tuple[int, ...]:
        """Bytes of each array."""
        return tuple(array.nbytes for array in self.arrays)

    @property
    def nbytes(self) -> int:
        """What the arrays take in shared memory."""
        return room_for(self.sizes)

    def write(self, memory: Bytes) -> None:
        """Put the arrays into shared memory."""
        self.memory = memory
        for array, start in zip(self.arrays, _starts(self.sizes), strict=True):
            memory[start : start + array.nbytes] = np.frombuffer(array, np.uint8)

    def write_file(self, descriptor: int) -> None:
        """Put the arrays into a file as they are in shared memory, without mapping it."""
        for array, start in zip(self.arrays, _starts(self.sizes), strict=True):
            at = 0
            while at < array.nbytes:  # one call writes 2 GiB at most
                at += os.pwrite(descriptor, array[at:], start + at)

    def shared(self) -> Any:
        """The value once more, its large arrays in the shared memory that they were written to."""
        return unpack(self.body, self.sizes, self.memory)


def pack(value: Any) -> Packed:
    """A value of plain classes. Equal values have equal pickles."""
    arrays: list[memoryview] = []

    def aside(buffer: pickle.PickleBuffer) -> bool:
        raw = buffer.raw()
        if raw.nbytes < APART:
            return True
        arrays.append(raw)
        return False

    file = io.BytesIO()
    pickler = pickle.Pickler(file, 5, buffer_callback=aside)
    # No references to what came before: else two equal values differ by which parts are the same
    # object.
    pickler.fast = True
    files: list[int] = []
    pickler.dispatch_table = {**_REDUCERS, OpenFile: partial(_numbered, files)}
    pickler.dump(value)
    return Packed(file.getvalue(), tuple(arrays), tuple(files))


def unpack(
    body: bytes | memoryview,
    sizes: Sequence[int],
    memory: Bytes | None,
    files: Sequence[int] = (),
) -> Any:
    """The value; its large arrays lie in `memory`, and hold it.  files: descriptors of its files,
    which stay the caller's."""
    raw = np.empty(0, np.uint8) if memory is None else memory
    token = _files.set(files)
    try:
        return pickle.loads(body, buffers=slices(raw, sizes))
    finally:
        _files.reset(token)


def slices(memory: Bytes, sizes: Sequence[int]) -> list[memoryview]:
    """The bytes of each array in shared memory."""
    placed = zip(_starts(sizes), sizes, strict=True)
    return [memory[start : start + size].data for start, size in placed]


_files: ContextVar[Sequence[int]] = ContextVar("files", default=())


def _numbered(files: list[int], file: OpenFile) -> tuple[Any, ...]:
    files.append(file.descriptor)
    return _opened, (len(files) - 1,)


def _opened(number: int) -> OpenFile:
    return OpenFile(_files.get()[number])


def _made_again(snapshot: Snapshot) -> tuple[Any, ...]:
    """By the paths of its files, which the other side opens."""
    return Snapshot, snapshot.parts


def _read_only(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


def _reduced(mapping: MappingProxyType[Any, Any]) -> tuple[Any, ...]:
    return _read_only, (dict(mapping),)


# What pickles cannot hold by themselves. A dict: a pickler asks it for every object.
_REDUCERS: dict[Any, Any] = {
    **copyreg.dispatch_table,
    MappingProxyType: _reduced,
    Snapshot: _made_again,
}


def room_for(sizes: Sequence[int]) -> int:
    """What arrays of these sizes take in shared memory."""
    return sum(_rounded(size) for size in sizes)


def _starts(sizes: Sequence[int]) -> list[int]:
    starts, at = [], 0
    for size in sizes:
        starts.append(at)
        at += _rounded(size)
    return starts


def _rounded(size: int) -> int:
    return -(-size // _STEP) * _STEP
