"""One device: its queue, its programs, its buffers. The pipeline sees OpenCL only through this."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial, wraps
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import DTypeLike, NDArray

import rhytid_kernels
from rhytid.device import driver
from rhytid.device.budget import BufferPool, MemoryBudget, Releasable
from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.driver import cl, driver_errors
from rhytid.device.figures import DROPPED, Figures
from rhytid.device.launches import (
    FIRST_WORK,
    LaunchPacing,
    LaunchPiece,
    launch_pieces,
    launch_shapes,
    maps_at_once,
)
from rhytid.device.memory import usual_device_memory
from rhytid.device.programs import NO_DEFINES, Programs
from rhytid.device.select import Candidate
from rhytid.errors import DeviceMemoryError

# Bytes that numpy aligns arrays to, and a page of memory.
_ALIGNED, _PAGE = 16, 4096
T = TypeVar("T")
Part = TypeVar("Part", bound=Releasable)
Group = TypeVar("Group", bound=BufferGroup)
Method = TypeVar("Method", bound=Callable[..., Any])


class Steps:
    """The steps of one thread on a device whose tasks run one at a time.

    call: runs one step in a task of the device.  check: called first in each step; may raise.
    Launches gather until the thread asks for anything else, and run in the same step as that.
    """

    def __init__(self, call: Callable[..., Any], check: Callable[[], None] | None = None) -> None:
        self._call, self._checks = call, [] if check is None else [check]
        self._launches: list[Callable[[], None]] = []
        self._made: list[Buffer | BufferGroup] = []

    def later(self, launch: Callable[[], None]) -> None:
        """Run a launch with the next step."""
        self._launches.append(launch)

    def step(self, task: Callable[[], Any]) -> Any:
        """Run a task after all launches so far, and return its result. A buffer that it returns
        counts as made by it."""
        launches, self._launches = self._launches, []
        found = self._call(_in_order, [*self._checks, *launches], task)
        if isinstance(found, Buffer):
            self.own(found)
        return found

    def own(self, made: Buffer | BufferGroup) -> None:
        """Count something as made in these steps: `give_back` releases it."""
        self._made.append(made)

    def hand_over(self) -> None:
        """Forget the buffers that were made so far: `give_back` leaves them alone."""
        self._made = []

    def give_back(self) -> None:
        """Release every buffer that was made, and forget launches that wait."""
        self._launches = []
        self._call(_in_order, [buffer.release for buffer in self._made], _nothing)


def _in_order(tasks: list[Callable[[], None]], last: Callable[[], Any]) -> Any:
    for task in tasks:
        task()
    return last()


def _nothing() -> None:
    """A task without a result."""


def _stepped(method: Method) -> Method:
    """Runs a method of a device as a step of a thread that uses it in steps."""

    @wraps(method)
    def run(self: Device, *arguments: Any, **named: Any) -> Any:
        steps = self.steps
        if steps is None:
            return method(self, *arguments, **named)
        return steps.step(partial(method, self, *arguments, **named))

    return run  # type: ignore[return-value]


class Device:
    """A context and an in-order queue on one device. One thread uses it at a time; others use it in
    the block of `in_steps`.

    memory: bytes that may be taken; None: a share of the device's.  shapes: how drawing can be cut
    into work-groups.  shape: how it is cut; the usual one, until a faster one is set.  work_pace:
    work of drawing a second, see `DrawingPace`; a guess until it is measured.  figures: counts what
    the device does; memory of this process alone where none are given.
    """

    def __init__(
        self, candidate: Candidate, memory: int | None, figures: Figures | None = None
    ) -> None:
        self.info = candidate
        self.figures = figures or Figures()
        self.pool = BufferPool()
        limit = memory or usual_device_memory(candidate)
        self.budget = MemoryBudget(limit, self.pool, self._dropped)
        self.born: list[Buffer] = []
        self._taking_back = self._take_back  # made once, not for every buffer
        self.pacing, self.work_pace = LaunchPacing(), FIRST_WORK
        self._of_thread = threading.local()
        self.shapes = launch_shapes(candidate.kind, candidate.local_memory, candidate.largest_group)
        self.shape = self.shapes[0]
        with driver_errors():
            self.context = driver.open_context(candidate.handle)
            self._queue = cl.CommandQueue(self.context)
        self.programs = Programs(self.context, candidate)

    def maps_at_once(self, sums: int) -> int:
        """How many maps a work-group draws at once: `maps_at_once` of launches.py."""
        return maps_at_once(self.shape, self.info.local_memory, sums)

    @property
    def ahead_defines(self) -> dict[str, object]:
        """The define of ahead.clh."""
        return {"AHEAD": 1} if self.info.kind == "cpu" else {}

    @property
    def steps(self) -> Steps | None:
        """The steps in which this thread uses the device; None where it uses it itself."""
        return getattr(self._of_thread, "steps", None)

    @contextmanager
    def in_steps(
        self, call: Callable[..., Any], check: Callable[[], None] | None = None
    ) -> Iterator[None]:
        """Let this thread use the device in a block: each upload, read and wait is one step that
        `call` runs in a task of the device, with the launches before it.

        Work of the host in the block is done on this thread. Where the block fails, every buffer
        that it made is given back, but for those of `hand_over`.  check: called first in each step;
        may raise.
        """
        steps = self._of_thread.steps = Steps(call, check)
        try:
            yield
            self.finish()
        except BaseException:
            steps.give_back()
            raise
        finally:
            self._of_thread.steps = None

    @_stepped
    def step(self, task: Callable[[], T]) -> T:
        """Run a task in a task of the device, after all launches so far, and return its result. A
        buffer that it returns is given back where the block of `in_steps` fails."""
        return task()

    def make_in_step(self, make: Callable[[], Group]) -> Group:
        """As `step`, for a group of buffers that is made anew: it is given back likewise."""
        found = self.step(make)
        if self.steps is not None:
            self.steps.own(found)
        return found

    def hand_over(self) -> None:
        """The buffers that this thread made in steps so far have another owner now, such as the
        memory budget: they stay even if the block of `in_steps` fails later."""
        if self.steps is not None:
            self.steps.hand_over()

    def lasting(self, make: Callable[[], T]) -> T:
        """What `make` makes on the device, which stays even if the task that needs it first fails
        later. In a task of the device."""
        before, self.born = self.born, []
        try:
            return make()
        except BaseException:
            for buffer in self.born:
                buffer.release()
            raise
        finally:
            self.born = before

    @contextmanager
    def task(self) -> Iterator[None]:
        """Wraps one piece of work: if it fails, every buffer that it made is released. This thread
        uses the device itself in the block, even if it uses it in steps outside of the block."""
        steps, self._of_thread.steps = self.steps, None
        self.budget.new_task()
        self.born.clear()
        # Once for all calls of the driver in it. The main thread stays interruptible between two.
        main = threading.current_thread() is threading.main_thread()
        try:
            with nullcontext() if main else driver.without_sigint():
                yield
        except BaseException:
            self.budget.forget_made()
            for buffer in self.born:
                buffer.release()
            raise
        finally:
            self._of_thread.steps = steps
            self._note_memory()

    @contextmanager
    def task_or_steps(self) -> Iterator[None]:
        """As `task`; where this thread uses the device in steps it goes on to do so in the
        block."""
        with nullcontext() if self.steps is not None else self.task():
            yield

    def _note_memory(self) -> None:
        self.figures.set(self.budget.limit, "limit")
        self.figures.set(self.budget.used, "used")
        self.figures.set(self.pool.held, "spare")

    def _dropped(self, key: Hashable) -> None:
        """Count an entry that the budget dropped: an asset, or something made of one."""
        names = key if isinstance(key, tuple) else ()
        self.figures.count("dropped", next((n for n in names[:2] if n in DROPPED), "other"))

    @_stepped
    def upload(self, array: NDArray[Any]) -> Buffer:
        """A buffer with the bytes of `array`."""
        host = np.ascontiguousarray(array)
        return self._buffer(host.nbytes, host if host.nbytes else None)

    @_stepped
    def upload_again(self, array: NDArray[Any]) -> Buffer:
        """As `upload`, of what comes again and again: into spare memory, where there is any, once
        all launches before are done. The first touch of fresh memory takes four times as long."""
        host = np.ascontiguousarray(array)
        buffer = self._buffer(host.nbytes)
        if host.nbytes:
            with driver_errors():
                cl.enqueue_copy(self._queue, buffer.handle, host)
        return buffer

    @_stepped
    def lend(self, array: NDArray[Any]) -> Buffer:
        """As `upload`, but on a processor the memory of `array` itself, which takes no copy: for
        kernels that only read it, at most _ALIGNED bytes at a time. Wider loads would end the
        process. Nobody writes to the array until the buffer is released."""
        host = np.ascontiguousarray(array)
        if not self._shares_memory or not host.nbytes or host.ctypes.data % _ALIGNED:
            return self._buffer(host.nbytes, host if host.nbytes else None)
        return self._over(host.reshape(-1).view(np.uint8), cl.mem_flags.READ_ONLY)

    @_stepped
    def readable(self, count: int, dtype: DTypeLike, zero: bool = False) -> Buffer:
        """As `empty`, for what the host is to have: `read` copies nothing on a processor, but gives
        the memory of the buffer, to which no kernel may write from then on.  zero: whether values
        are 0 at first."""
        nbytes = count * np.dtype(dtype).itemsize
        if not self._shares_memory or not nbytes:
            return self.full(count, np.dtype(dtype).type(0)) if zero else self._buffer(nbytes)
        return self._over(_aligned(nbytes, zero), cl.mem_flags.READ_WRITE)

    @property
    def _shares_memory(self) -> bool:
        """Whether kernels can use arrays of the host where they lie."""
        return self.info.kind == "cpu"

    def _over(self, host: NDArray[np.uint8], access: int) -> Buffer:
        """A buffer that is the memory of an array."""
        self.budget.reserve(host.nbytes, reuse=False)
        buffer = Buffer(host.nbytes, None, self._taking_back)
        self.born.append(buffer)
        self._check_size(host.nbytes)
        with driver_errors():
            flags = access | cl.mem_flags.USE_HOST_PTR
            buffer.handle = cl.Buffer(self.context, flags, hostbuf=host)
        buffer.host = host
        return buffer

    @_stepped
    def empty(self, count: int, dtype: DTypeLike) -> Buffer:
        """A buffer for `count` values, not initialised."""
        return self._buffer(count * np.dtype(dtype).itemsize)

    @_stepped
    def full(self, count: int, value: np.generic) -> Buffer:
        """A buffer of `count` times the value of a numpy scalar."""
        buffer = self._buffer(count * value.nbytes)
        with driver_errors():
            cl.enqueue_fill_buffer(self._queue, buffer.handle, value, 0, buffer.nbytes)
        return buffer

    def _buffer(self, nbytes: int, host: NDArray[Any] | None = None) -> Buffer:
        """A buffer with the bytes of `host`, or uninitialised and out of spare memory, where there
        is any."""
        spare = self.budget.reserve(nbytes, reuse=host is None)
        buffer = Buffer(nbytes, spare, self._taking_back)
        self.born.append(buffer)
        if spare is None:
            buffer.handle = self._allocate(nbytes, host)
        return buffer

    def _allocate(self, nbytes: int, host: NDArray[Any] | None) -> Any:
        """Memory of the driver with the bytes of `host`, or uninitialised."""
        self._check_size(nbytes)
        flags = cl.mem_flags.READ_WRITE
        if host is not None:
            flags |= cl.mem_flags.COPY_HOST_PTR
        with driver_errors():
            return cl.Buffer(self.context, flags, max(nbytes, 1), hostbuf=host)

    def _check_size(self, nbytes: int) -> None:
        """Raise DeviceMemoryError where one buffer of the device cannot be so large."""
        if nbytes > self.info.largest_buffer:
            raise DeviceMemoryError(
                f"a buffer of {nbytes} bytes: {self.info.name} gives {self.info.largest_buffer} "
                "bytes at most"
            )

    @_stepped
    def _take_back(self, buffer: Buffer) -> None:
        if not buffer.released:
            buffer.released = True
            self.budget.free(buffer.nbytes)
            if buffer.host is not None:
                self._end_loan(buffer)
            elif buffer.handle is not None:
                self.pool.leave(buffer.handle, buffer.nbytes)

    def _end_loan(self, buffer: Buffer) -> None:
        """Let go of memory of the host, once no launch uses it."""
        with driver_errors():
            self._queue.finish()
            buffer.handle.release()
        buffer.handle = buffer.host = None

    @_stepped
    def read(self, buffer: Buffer, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """The first values of a buffer; waits for all launches before. Those of `readable` are in
        the memory of the buffer, where the device shares it."""
        if buffer.host is not None:
            return self._seen(buffer, buffer.host, shape, np.dtype(dtype))
        host = np.empty(shape, dtype)
        if host.size:
            self._copy_to(host, buffer)
        return host

    def _seen(
        self, buffer: Buffer, host: NDArray[np.uint8], shape: tuple[int, ...], dtype: np.dtype[Any]
    ) -> NDArray[Any]:
        """The first values of memory that the device shares, once the host may see them."""
        with driver_errors():
            flags = cl.map_flags.READ
            seen, _ = cl.enqueue_map_buffer(
                self._queue, buffer.handle, flags, 0, (buffer.nbytes,), np.uint8, is_blocking=True
            )
            seen.base.release(self._queue)
            self._queue.finish()
        return host[: math.prod(shape) * dtype.itemsize].view(dtype).reshape(shape)

    def _copy_to(self, host: NDArray[Any], buffer: Buffer) -> None:
        self._copy_all([(host, buffer, {})])

    def _copy_all(self, copies: Sequence[_Copy]) -> None:
        """Copy to the host and wait for all of it. The copies alone are timed, from when all
        launches are done: they are enqueued before that, so that the driver goes on to them by
        itself."""
        # All are kept and waited for: an event that goes before its copy is done waits for it, and
        # lets no other thread of Python run meanwhile.
        events: list[Any] = []
        with driver_errors():
            try:
                events.append(cl.enqueue_marker(self._queue))
                for host, buffer, places in copies:
                    events.append(
                        cl.enqueue_copy(
                            self._queue, host, buffer.handle, is_blocking=False, **places
                        )
                    )
                events[0].wait()
                start = time.perf_counter_ns()
            finally:
                for event in events:
                    event.wait()
            self.figures.read_back(time.perf_counter_ns() - start)

    def read_square(
        self, buffer: Buffer, stride: int, row: int, column: int, side: int
    ) -> NDArray[np.float32]:
        """(side, side) float32 from (row, column) on, of a buffer with rows of `stride` values;
        waits as `read` does."""
        host = np.empty((side, side), np.float32)
        self.read_squares([(buffer, stride, row, column)], [host])
        return host

    @_stepped
    def read_squares(
        self, places: Sequence[tuple[Buffer, int, int, int]], outs: Sequence[NDArray[Any]]
    ) -> None:
        """Several squares, as `read_square` reads one, with one wait for all.

        places: buffer, stride, row and column of each.  outs: (side, side), takes its values, which
        are of its type; its rows may be parts of those of a larger array.
        """
        self._copy_all([_square(*one) for one in zip(places, outs, strict=True)])

    def copy_square(
        self, source: Buffer, target: Buffer, to: tuple[int, int], side: int, item: int
    ) -> None:
        """Copy `source`, rows of `side` items of `item` bytes, into a larger square with rows of
        `to[1]` items, from its item `to[0]` on."""
        if self.steps is None:
            self._copy_square(source, target, to, side, item)
        else:
            self.steps.later(partial(self._copy_square, source, target, to, side, item))

    def _copy_square(
        self, source: Buffer, target: Buffer, to: tuple[int, int], side: int, item: int
    ) -> None:
        first, stride = to
        row, column = divmod(first, stride)
        with driver_errors():
            cl.enqueue_copy(
                self._queue, target.handle, source.handle, region=(item * side, side, 1),
                src_origin=(0, 0, 0), dst_origin=(item * column, row, 0),
                src_pitches=(item * side,), dst_pitches=(item * stride,),
            )  # fmt: skip

    def launch(
        self,
        program: str,
        kernel: str,
        size: tuple[int, ...],
        *arguments: Any,
        group: tuple[int, ...] | None = None,
        defines: Mapping[str, object] = NO_DEFINES,
    ) -> None:
        """Enqueue a kernel over `size` work-items; scalars are numpy scalars of the exact type."""
        if 0 in size:
            return
        if self.steps is None:
            self._launch(program, kernel, size, arguments, group, defines)
        else:
            # Compiled here, while others use the device.
            self.programs.kernel(program, kernel, defines)
            launch = partial(self._launch, program, kernel, size, arguments, group, defines)
            self.steps.later(launch)

    def _launch(
        self,
        program: str,
        kernel: str,
        size: tuple[int, ...],
        arguments: tuple[Any, ...],
        group: tuple[int, ...] | None,
        defines: Mapping[str, object],
    ) -> None:
        handles = [a.handle if isinstance(a, Buffer) else a for a in arguments]
        compiled = self.programs.kernel(program, kernel, defines)
        self.programs.tell_values(compiled, handles)
        pieces = (
            launch_pieces(size, self.info.largest_group)
            if group is None
            else [LaunchPiece(None, size, group)]
        )
        with driver_errors():
            for piece in pieces:
                compiled(self._queue, piece.size, piece.group, *handles, global_offset=piece.offset)

    @_stepped
    def finish(self) -> None:
        """Wait until all launches are done; raises DeviceError where the queue broke."""
        with driver_errors():
            self._queue.finish()

    def digest(self, program: str) -> str:
        """Twelve hexadecimal digits that change with the source of a program."""
        return rhytid_kernels.digest(program)


# An array of the host, a buffer, and what of them is copied.
_Copy = tuple[NDArray[Any], Buffer, Mapping[str, Any]]


def _square(place: tuple[Buffer, int, int, int], out: NDArray[Any]) -> _Copy:
    """The copy of a square, as `Device.read_squares` has it."""
    buffer, stride, row, column = place
    side, apart, size = len(out), out.strides[0], out.itemsize
    # From the first value to the last. What lies between two rows is not touched.
    span = as_strided(out, ((side - 1) * apart // size + side,), (size,))
    places = {
        "buffer_origin": (size * column, row, 0),
        "host_origin": (0, 0, 0),
        "region": (size * side, side, 1),
        "buffer_pitches": (size * stride,),
        "host_pitches": (apart,),
    }
    return span, buffer, places


def _aligned(nbytes: int, zero: bool) -> NDArray[np.uint8]:
    """An array of so many bytes from the start of a page on, as drivers want it."""
    whole = np.zeros(nbytes + _PAGE, np.uint8) if zero else np.empty(nbytes + _PAGE, np.uint8)
    start = -whole.ctypes.data % _PAGE
    return whole[start : start + nbytes]


class OnFirstUse(Generic[Part]):
    """A part of something on the device that few need: made when it is first asked for, and there
    until `release`."""

    def __init__(self, device: Device, make: Callable[[], Part]) -> None:
        self._device, self._make = device, make
        self._made: Part | None = None

    def get(self) -> Part:
        """The part, made in a step of this thread where there is none."""
        return self._device.step(self._found)

    def release(self) -> None:
        """Give the memory back, if there is any."""
        if self._made is not None:
            self._made.release()

    def _found(self) -> Part:
        if self._made is None:
            self._made = self._device.lasting(self._make)
        return self._made
