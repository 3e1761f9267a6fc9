"""Wrinkle graphs as safetensors: one tensor an array of WrinkleGraph, by its name; the metadata say
what the graph was made with."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, deserialize

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
    """The pieces of `graph_pieces` as one."""
    return b"".join(graph_pieces(graph, metadata))


def graph_pieces(
    graph: WrinkleGraph, metadata: Mapping[str, str] | None = None
) -> Iterator[bytes | memoryview]:
    """A safetensors file of the graph, in pieces that are views of its arrays, for it may be large;
    the same graph and metadata give the same bytes.

    The origin of the graph goes into the metadata, beside those given.
    """
    # The library joins the file in memory, and writes metadata in random order, which would change
    # every id made from content. The order of tensors is that of the library.
    tensors = sorted(graph.arrays().items(), key=lambda one: (_dtype(one[0]) != "F32", one[0]))
    origin = {} if graph.origin is None else graph.origin.metadata()
    yield _header(tensors, {**(metadata or {}), **origin})
    for _, array in tensors:
        yield array.astype(array.dtype.newbyteorder("<"), copy=False).ravel().view(np.uint8).data


def _header(tensors: list[tuple[str, NDArray[Any]]], metadata: Mapping[str, str]) -> bytes:
    """What stands before the numbers of tensors, padded so that these stay aligned."""
    header: dict[str, Any] = {"__metadata__": dict(sorted(metadata.items()))} if metadata else {}
    end = 0
    for name, array in tensors:
        start, end = end, end + array.nbytes
        header[name] = {
            "dtype": _dtype(name),
            "shape": array.shape,
            "data_offsets": [start, end],
        }
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text


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


def _dtype(name: str) -> str:
    return _DTYPES.get(name, "F32")


def _metadata(data: bytes) -> dict[str, str]:
    """The metadata of a file: the library's reader of bytes does not return them."""
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    found: dict[str, str] = header.get("__metadata__") or {}
    return found


def _array(name: str, tensor: Mapping[str, Any]) -> NDArray[Any]:
    dtype = _dtype(name)
    if tensor["dtype"] != dtype:
        raise GraphError(f"{name} has dtype {tensor['dtype']}, not {dtype}")
    check_size(name, len(tensor["data"]) // 4)
    flat = np.frombuffer(tensor["data"], "<i4" if dtype == "I32" else "<f4")
    array: NDArray[Any] = flat.reshape(tensor["shape"])
    return array
