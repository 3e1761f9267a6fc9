"""Compiled programs and kernels of a device."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

import rhytid_kernels
from rhytid.device import driver, watch
from rhytid.device.driver import cl
from rhytid.device.select import Candidate
from rhytid.errors import DeviceError, KernelBuildError

BUILD_OPTIONS = ("-cl-std=CL1.2",)
_Defines = tuple[tuple[str, object], ...]
# Arguments that are values, and what pyopencl is told of them: that they are their own bytes.
_VALUES, _VALUE = (np.generic, np.ndarray), np.dtype(np.void)
NO_DEFINES: Mapping[str, object] = MappingProxyType({})


class Programs:
    """Programs of a context, each compiled once for each set of defines."""

    def __init__(self, context: Any, candidate: Candidate) -> None:
        self._context, self._info = context, candidate
        self._programs: dict[tuple[str, _Defines], Any] = {}
        self._kernels: dict[tuple[str, str, _Defines], Any] = {}
        # One thread builds a program, others wait for it.
        self._building: dict[tuple[str, _Defines], threading.Lock] = {}
        self._noted: dict[tuple[str, _Defines], None] = {}
        self._told: set[Any] = set()

    def kernel(self, program: str, kernel: str, defines: Mapping[str, object] = NO_DEFINES) -> Any:
        """A compiled kernel; its program is compiled once for each set of defines.

        Raises KernelBuildError where it does not compile, DeviceError where it needs too much local
        memory.
        """
        given = tuple(sorted(defines.items()))
        self._noted[program, given] = None
        key = (program, kernel, given)
        if key not in self._kernels:
            self._kernels[key] = self.fitting(cl.Kernel(self._program(program, given), kernel))
        return self._kernels[key]

    def tell_values(self, kernel: Any, arguments: Sequence[Any]) -> None:
        """Tell a kernel, before its first launch, which of its arguments are values, numpy scalars
        or arrays; the others are buffers or None. pyopencl else tries each as a buffer first, which
        costs it an exception for every value of every launch.
        """
        if kernel not in self._told:
            kernel.set_arg_types([_VALUE if isinstance(a, _VALUES) else None for a in arguments])
            self._told.add(kernel)

    def prepare(self, program: str, defines: Mapping[str, object]) -> None:
        """Build a program, unless it is built, for kernels that are asked for later. From any
        thread; raises what `kernel` does, and FileNotFoundError where there is no such program."""
        self._program(program, tuple(sorted(defines.items())))

    def begin_noting(self) -> None:
        """Forget what `noted` has."""
        self._noted = {}

    @property
    def noted(self) -> list[tuple[str, _Defines]]:
        """The programs whose kernels were asked for since `begin_noting`, in their order."""
        return list(self._noted)

    def _program(self, name: str, defines: _Defines) -> Any:
        key = (name, defines)
        if key not in self._programs:
            watch.tell_of_compiling()  # by this thread or by another, for which it waits
            with self._building.setdefault(key, threading.Lock()):
                if key not in self._programs:
                    options = [
                        *BUILD_OPTIONS,
                        *(f"-D{define}={value}" for define, value in defines),
                    ]
                    self._programs[key] = self.build(rhytid_kernels.source(name), options)
        return self._programs[key]

    def fitting(self, kernel: Any) -> Any:
        """The kernel itself. Raises DeviceError where it needs more local memory than a work-group
        has: some drivers report that in words of their own, and others do not."""
        asked = cl.kernel_work_group_info.LOCAL_MEM_SIZE
        needed = kernel.get_work_group_info(asked, self._info.handle)
        if needed > self._info.local_memory:
            raise DeviceError(
                f"kernel {kernel.function_name} needs {needed} bytes of local memory: "
                f"{self._info.name} has {self._info.local_memory}"
            )
        return kernel

    def build(self, text: str, options: list[str]) -> Any:
        """A program from source text; raises KernelBuildError with the compiler's log."""
        try:
            return driver.compile_program(self._context, text, options)
        except cl.RuntimeError as error:
            raise KernelBuildError(str(error)) from error
