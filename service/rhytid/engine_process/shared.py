"""Memory that two processes share: a file without a name, which goes with the last that maps it."""

from __future__ import annotations

import ctypes
import mmap
import os
import tempfile
import weakref
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
