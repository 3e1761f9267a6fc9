"""A piece of work on a device: launches in bounded blocks, buffers given back at the end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rhytid.device.runtime import Buffer, Device

T = TypeVar("T")
# Runs one call on the thread that owns the device.
Caller = Callable[..., Any]
# Work-items of a launch: few enough that none keeps the device, or a cancellation, waiting long.
BLOCK = 1 << 18
_GROUP = 64


def directly(task: Callable[..., T], *arguments: Any, **named: Any) -> T:
    """Run a call on this thread."""
    return task(*arguments, **named)


class Workspace:
    """Buffers and launches of a `with` block; what the block made is released at its end.

    call: runs each single step on the device's thread, so that others may use it in between.
    """

    def __init__(self, device: Device, call: Caller = directly) -> None:
        self._device, self._call = device, call
        self._buffers: list[Buffer] = []

    def room(self) -> Workspace:
        """Another workspace on the same device, for a part of the work."""
        return Workspace(self._device, self._call)

    def __enter__(self) -> Workspace:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release(*self._buffers)

    def upload(self, array: NDArray[Any]) -> Buffer:
        """A buffer with the bytes of `array`."""
        return self._mine(self._call(self._device.upload, array))

    def empty(self, count: int, dtype: DTypeLike) -> Buffer:
        """A buffer for `count` values, not initialised."""
        return self._mine(self._call(self._device.empty, count, dtype))

    def full(self, count: int, value: np.generic) -> Buffer:
        """A buffer of `count` times a numpy scalar."""
        return self._mine(self._call(self._device.full, max(count, 1), value))

    def read(self, buffer: Buffer, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """The first values of a buffer; waits for all launches before."""
        found: NDArray[Any] = self._call(self._device.read, buffer, shape, dtype)
        return found

    def run(
        self,
        program: str,
        kernel: str,
        count: int,
        *arguments: Any,
        defines: Mapping[str, object] | None = None,
        report: Callable[[float], None] | None = None,
    ) -> None:
        """Launch a kernel over `count` work-items whose first arguments are (first, count).

        Plain ints go as int32 and floats as float32.  report: called with the share that is done
        after each block, and may raise.
        """
        values = [_scalar(a) for a in arguments]
        for first in range(0, count, BLOCK):
            size = -(-min(BLOCK, count - first) // _GROUP) * _GROUP
            head = (np.int32(first), np.int32(count))
            self._call(
                self._device.launch, program, kernel, (size,), *head, *values,
                group=(_GROUP,), defines=defines or {},
            )  # fmt: skip
            if report is not None:
                self._call(self._device.finish)
                report(min(first + BLOCK, count) / count)

    def release(self, *buffers: Buffer) -> None:
        """Give buffers back before the end."""
        for buffer in buffers:
            self._call(buffer.release)
        given = set(map(id, buffers))
        self._buffers = [b for b in self._buffers if id(b) not in given]

    def _mine(self, buffer: Buffer) -> Buffer:
        self._buffers.append(buffer)
        return buffer


def _scalar(value: Any) -> Any:
    if isinstance(value, bool | int):
        return np.int32(value)
    return np.float32(value) if isinstance(value, float) else value
