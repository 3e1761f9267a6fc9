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
from functools import cache, cached_property, partial
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


def handed_on(descriptor: int, nbytes: int) -> Bytes:
    """As `private`, and read-only: arrays of it are sent on in the file that they lie in, without a
    copy. Holds a descriptor until its last array is forgotten: for few and large files alone."""
    memory = private(descriptor, nbytes)
    memory.flags.writeable = False  # what was written here would not be sent on
    address, file = memory.ctypes.data, _KeptFile(os.dup(descriptor), nbytes)
    _kept[address] = file
    # What is registered last is called first: before the memory is given back.
    weakref.finalize(memory, _let_go, address, file).atexit = False
    return memory


@dataclass(frozen=True)
class _KeptFile:
    descriptor: int
    nbytes: int


# Files of memory that may be sent on, by the address that they are mapped to.
_kept: dict[int, _KeptFile] = {}


def _let_go(address: int, file: _KeptFile) -> None:
    _kept.pop(address, None)
    os.close(file.descriptor)


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


# Start and bytes of each array in shared memory.
Places = Sequence[tuple[int, int]]


@dataclass
class Packed:
    """A value as a pickle, the bytes of its large arrays, and the descriptors of its files.

    memory: shared memory of its own that the arrays were written to last, None where they were not.
    """

    body: bytes
    arrays: tuple[memoryview, ...]
    files: tuple[int, ...] = ()
    memory: Bytes | None = None

    @cached_property
    def places(self) -> Places:
        """Where the arrays are written to in shared memory."""
        return places_of([array.nbytes for array in self.arrays])

    @property
    def nbytes(self) -> int:
        """What the arrays take in shared memory."""
        if not self.places:
            return 0
        start, size = self.places[-1]
        return start + -(-size // _STEP) * _STEP

    def write(self, memory: Bytes) -> None:
        """Put the arrays into shared memory, which nothing else is written to."""
        self.lend(memory)
        self.memory = memory

    def lend(self, memory: Bytes) -> None:
        """Put the arrays into shared memory that others are written to later."""
        for array, (start, size) in zip(self.arrays, self.places, strict=True):
            memory[start : start + size] = np.frombuffer(array, np.uint8)

    def write_file(self, descriptor: int) -> None:
        """Put the arrays into a file as they are in shared memory, without mapping it."""
        for array, (start, size) in zip(self.arrays, self.places, strict=True):
            at = 0
            while at < size:  # one call writes 2 GiB at most
                at += os.pwrite(descriptor, array[at:], start + at)

    def shared(self) -> Any:
        """The value once more, its large arrays in the shared memory that they were written to, or
        copied where that has others by now."""
        if self.memory is None:
            self.write(np.empty(self.nbytes, np.uint8))
        return unpack(self.body, self.places, self.memory)

    def kept_file(self) -> tuple[int, int, Places] | None:
        """The descriptor and the bytes of the file that all arrays lie in already, and where they
        do; None where they do not lie in one of `handed_on`."""
        if not self.arrays:
            return None
        addresses = [np.frombuffer(array, np.uint8).ctypes.data for array in self.arrays]
        for base, file in list(_kept.items()):
            starts = [address - base for address in addresses]
            places = [
                (start, array.nbytes) for start, array in zip(starts, self.arrays, strict=True)
            ]
            if min(starts) >= 0 and max(map(sum, places)) <= file.nbytes:
                return file.descriptor, file.nbytes, places
        return None


def places_of(sizes: Sequence[int]) -> Places:
    """Where arrays of these sizes are written to, one after the other."""
    places, at = [], 0
    for size in sizes:
        places.append((at, size))
        at += -(-size // _STEP) * _STEP
    return places


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
    places: Places,
    memory: Bytes | None,
    files: Sequence[int] = (),
) -> Any:
    """The value; its large arrays lie in `memory`, and hold it.  files: descriptors of its files,
    which stay the caller's."""
    raw = np.empty(0, np.uint8) if memory is None else memory
    token = _files.set(files)
    try:
        return pickle.loads(body, buffers=slices(raw, places))
    finally:
        _files.reset(token)


def slices(memory: Bytes, places: Places) -> list[memoryview]:
    """The bytes of each array in shared memory."""
    return [memory[start : start + size].data for start, size in places]


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
