"""A piece of work on a device: launches in bounded blocks, buffers given back at the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.support import cancellation

T = TypeVar("T")
# Runs one call in a task of the device.
Caller = Callable[..., Any]
_GROUP = 64


def directly(task: Callable[..., T], *arguments: Any, **named: Any) -> T:
    """Run a call on this thread."""
    return task(*arguments, **named)


class Workspace:
    """Buffers and launches of a `with` block, which releases at its end all buffers made in it.

    call: runs each single step in a task of the device, so that others may use it in between.
    """

    def __init__(self, device: Device, call: Caller = directly) -> None:
        self._device, self._call = device, call
        self._buffers: list[Buffer] = []

    def nested(self) -> Workspace:
        """A workspace on the same device for a part of the work, with buffers of its own."""
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
        return self._mine(self._step(self._device.upload, array))

    def lend(self, array: NDArray[Any]) -> Buffer:
        """As `upload`, but the memory of `array` itself where the device can use it. Kernels only
        read it, and nobody writes to it until the buffer is released."""
        return self._mine(self._step(self._device.lend, array))

    def readable(self, count: int, dtype: DTypeLike, zero: bool = False) -> Buffer:
        """As `empty`, for what is read at the end: no kernel may write to it after that.  zero:
        whether values are 0 at first."""
        return self._mine(self._step(self._device.readable, max(count, 1), dtype, zero))

    def empty(self, count: int, dtype: DTypeLike) -> Buffer:
        """A buffer for `count` values, not initialised."""
        return self._mine(self._step(self._device.empty, count, dtype))

    def full(self, count: int, value: np.generic) -> Buffer:
        """A buffer of `count` times a numpy scalar."""
        return self._mine(self._step(self._device.full, max(count, 1), value))

    def read(self, buffer: Buffer, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """The first values of a buffer; waits for all launches before."""
        found: NDArray[Any] = self._step(self._device.read, buffer, shape, dtype)
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

        Plain ints are passed as int32 and floats as float32. The launch is cut into blocks, on
        which the result of the kernel may not depend.  report: called after each block with the
        share that is done; may raise.
        """
        self._device.programs.kernel(
            program, kernel, defines or {}
        )  # compiled here, not on its thread
        values, first = [_scalar(a) for a in arguments], 0
        while first < count:
            first = self._step(self._block, program, kernel, first, count, values, defines or {})
            if report is not None:
                report(first / count)

    def _block(
        self,
        program: str,
        kernel: str,
        first: int,
        count: int,
        values: Sequence[Any],
        defines: Mapping[str, object],
    ) -> int:
        """Launch a kernel from one work-item on and wait for it; the first that is left."""
        items = min(self._device.pacing.items(program, kernel), count - first)
        start = time.perf_counter()
        self._device.launch(
            program, kernel, (-(-items // _GROUP) * _GROUP,), np.int32(first), np.int32(count),
            *values, group=(_GROUP,), defines=defines,
        )  # fmt: skip
        self._device.finish()
        self._device.pacing.took(program, kernel, items, time.perf_counter() - start)
        return first + items

    def release(self, *buffers: Buffer) -> None:
        """Give buffers back before the end."""
        for buffer in buffers:
            self._call(buffer.release)
        given = set(map(id, buffers))
        self._buffers = [b for b in self._buffers if id(b) not in given]

    def _step(self, task: Callable[..., T], *arguments: Any) -> T:
        """One call in a task of the device, unless the work is to stop."""
        cancellation.check()
        result: T = self._call(task, *arguments)
        return result

    def _mine(self, buffer: Buffer) -> Buffer:
        self._buffers.append(buffer)
        return buffer


def _scalar(value: Any) -> Any:
    if isinstance(value, bool | int):
        return np.int32(value)
    return np.float32(value) if isinstance(value, float) else value
