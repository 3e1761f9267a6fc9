"""Helpers of the kernels, called through a generated kernel of one line.

A work-item reads its own element of every input under the input's name, evaluates one expression
and stores it: a test that fails names a function of a few lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

import rhytid_kernels
from rhytid.device.driver import cl
from rhytid.device.programs import BUILD_OPTIONS
from rhytid.device.runtime import Device

# Work-items of a group: PoCL compiles a kernel anew for each size.
_GROUP = 64
_C_TYPES = {"f4": "float", "i4": "int", "u4": "uint", "i1": "char", "i2": "short"}


def evaluate(
    device: Device,
    helper: str,
    expression: str,
    inputs: dict[str, NDArray[Any]],
    out: DTypeLike = np.float32,
    width: int = 1,
    options: Sequence[str] = (),
) -> NDArray[Any]:
    """`expression` with the helpers of `helper`.clh over the rows of the inputs, (n,) or (n, k).

    A row of k values is a vector of k lanes. Answers (n,), or (n, width) for a vector expression.
    """
    kind = _C_TYPES[np.dtype(out).str[1:]]
    stored = f"out[i] = {expression};" if width == 1 else f"vstore{width}({expression}, i, out);"
    arguments = [f"__global const {_c_type(a)} *in_{name}" for name, a in inputs.items()]
    text = f"""{f'#include "{helper}.clh"' if helper else ""}
__kernel void one_line({", ".join([*arguments, f"__global {kind} *out"])})
{{
    int i = get_global_id(0);
    {" ".join(_load(name, array) for name, array in inputs.items())}
    {stored}
}}"""
    count = len(next(iter(inputs.values())))
    whole = -(-count // _GROUP) * _GROUP
    rows = [np.resize(a, (whole, *a.shape[1:])) for a in inputs.values()]
    result = np.zeros((whole, width) if width > 1 else whole, out)
    return run(device, text, "one_line", (whole,), rows, result, options, (_GROUP,))[:count]


def run(
    device: Device,
    text: str,
    kernel: str,
    size: tuple[int, ...],
    arguments: Sequence[ArrayLike],
    out: NDArray[Any],
    options: Sequence[str] = (),
    group: tuple[int, ...] | None = None,
) -> NDArray[Any]:
    """Launch a kernel of `text`, its helpers put in; arrays are uploaded, numpy scalars are passed
    as they are (None is NULL), and `out`, the last argument, comes back as the kernel left it."""
    compiled = _kernel(device, text, kernel, tuple(options))
    queue = cl.CommandQueue(device.context)
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    handles = [
        cl.Buffer(device.context, flags, hostbuf=np.ascontiguousarray(a)) if np.ndim(a) else a
        for a in (*arguments, out)
    ]
    compiled(queue, size, group, *handles)
    result = np.empty_like(out)
    cl.enqueue_copy(queue, result, handles[-1])
    return result


def vector(*values: float, kind: DTypeLike = np.float32) -> np.void:
    """A small vector as `run` passes it by value."""
    named = np.dtype([(name, kind) for name in "xyzw"[: len(values)]])
    found: np.void = np.array(values, named)[()]
    return found


@cache
def _kernel(device: Device, text: str, kernel: str, options: tuple[str, ...]) -> Any:
    program = device.programs.build(rhytid_kernels.expand(text), [*BUILD_OPTIONS, *options])
    return device.programs.fitting(getattr(program, kernel))


def _c_type(array: NDArray[Any]) -> str:
    return _C_TYPES[array.dtype.str[1:]]


def _load(name: str, array: NDArray[Any]) -> str:
    kind = _c_type(array)
    if array.ndim == 1:
        return f"{kind} {name} = in_{name}[i];"
    width = array.shape[1]
    return f"{kind}{width} {name} = vload{width}(i, in_{name});"
