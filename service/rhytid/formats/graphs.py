"""Wrinkle graphs as safetensors: one tensor an array of WrinkleGraph, by its name; the metadata say
what the graph was made with."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, deserialize
from safetensors.numpy import save

from rhytid.domain.graph import ARRAYS, REQUIRED, GraphOrigin, WrinkleGraph
from rhytid.errors import GraphError
from rhytid.formats.limits import check_size

_DTYPES = dict.fromkeys(
    (
        *("edge_nodes", "node_triangle", "edge_triangle"),
        *("node_copy_of", "edge_copy_of", "edge_partners", "node_kind"),
    ),
    "I32",
)
# The library declares no types: name -> {dtype, shape, data}.
_deserialize: Callable[[bytes], list[tuple[str, dict[str, Any]]]] = deserialize


def write_graph(graph: WrinkleGraph, metadata: Mapping[str, str] | None = None) -> bytes:
    """A safetensors file of the graph; the same graph and metadata give the same bytes.

    The origin of the graph goes into the metadata, beside those given.
    """
    data = save(graph.arrays())
    origin = {} if graph.origin is None else graph.origin.metadata()
    metadata = {**(metadata or {}), **origin}
    if not metadata:
        return data
    # The library writes metadata in random order, which would change every id made from content.
    start = 8 + int.from_bytes(data[:8], "little")
    header = {"__metadata__": dict(sorted(metadata.items())), **json.loads(data[8:start])}
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + data[start:]


def read_graph(data: bytes) -> WrinkleGraph:
    """The wrinkle graph of a safetensors file.

    Its origin is None where the metadata say nothing of it. Raises GraphError naming the tensor
    that is unknown, missing, of another dtype or shape, or whose values cannot be used, or the
    metadata that cannot; LimitError over a tensor that is too large.
    """
    try:
        tensors = dict(_deserialize(data))
    except SafetensorError as exc:
        raise GraphError(f"not a readable safetensors file: {exc}") from exc
    for name in tensors:
        if name not in ARRAYS:
            raise GraphError(f"unknown tensor {name!r:.80}; known are {', '.join(ARRAYS)}")
    for name in REQUIRED:
        if name not in tensors:
            raise GraphError(f"the tensor {name} is missing")
    arrays = {name: _array(name, tensor) for name, tensor in tensors.items()}
    return WrinkleGraph(**arrays, origin=GraphOrigin.parse(_metadata(data)))


def _metadata(data: bytes) -> dict[str, str]:
    """The metadata of a file: the library's reader of bytes does not return them."""
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    found: dict[str, str] = header.get("__metadata__") or {}
    return found


def _array(name: str, tensor: Mapping[str, Any]) -> NDArray[Any]:
    dtype = _DTYPES.get(name, "F32")
    if tensor["dtype"] != dtype:
        raise GraphError(f"{name} has dtype {tensor['dtype']}, not {dtype}")
    check_size(name, len(tensor["data"]) // 4)
    flat = np.frombuffer(tensor["data"], "<i4" if dtype == "I32" else "<f4")
    array: NDArray[Any] = flat.reshape(tensor["shape"])
    return array
