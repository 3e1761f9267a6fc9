"""Wrinkle graphs as safetensors: the same bytes every time, and nothing unknown let in."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from safetensors.numpy import load, save

from rhytid.domain.graph import WrinkleGraph
from rhytid.errors import GraphError
from rhytid.formats.graphs import graph_pieces, read_graph, write_graph

ARRAYS: dict[str, Any] = {
    "node_uv": np.array([[0.1, 0.1], [0.2, 0.1], [1.5, 0.9]], np.float32),
    "node_weight": np.array([0, 0.5, 1], np.float32),
    "node_radius": np.array([0.01, 0.02, 0.03], np.float32),
    "edge_nodes": np.array([[0, 1], [2, 1]], np.int32),
    "edge_weight": np.array([0.25, 1], np.float32),
    "edge_half_width": np.array([0.01, 0.02], np.float32),
}
OPTIONAL: dict[str, Any] = {
    "node_metric": np.array([[4, 0, 4], [4, 1, 9], [1, 0, 1]], np.float32),
    "node_triangle": np.array([-1, 0, 7], np.int32),
    "edge_triangle": np.array([-1, 3], np.int32),
    "node_copy_of": np.array([-1, 0, 0], np.int32),
    "edge_copy_of": np.array([-1, 0], np.int32),
    "edge_metric": np.array([[0, 0, 0], [4, 1, 9]], np.float32),
    "edge_share": np.array([0, 2.5], np.float32),
}
METADATA = {"asset": "a1b2", "seed": "1", "unit": "µm", "": "empty"}


def same_graph(graph: WrinkleGraph, arrays: dict[str, Any]) -> None:
    assert graph.arrays().keys() == arrays.keys()
    for name, array in graph.arrays().items():
        np.testing.assert_array_equal(array, arrays[name], strict=True)


@pytest.mark.parametrize("names", [[], ["node_metric"], list(OPTIONAL)])
def test_what_is_written_is_read_back(names: list[str]) -> None:
    arrays = {**ARRAYS, **{name: OPTIONAL[name] for name in names}}
    for metadata in (None, {}, METADATA):
        data = write_graph(WrinkleGraph(**arrays), metadata)
        same_graph(read_graph(data), arrays)
        assert load(data).keys() == arrays.keys()


def test_the_same_graph_is_the_same_bytes_with_its_metadata_in_order() -> None:
    graph = WrinkleGraph(**ARRAYS, **OPTIONAL)
    backwards = dict(reversed(METADATA.items()))
    written = {write_graph(graph, m) for m in (METADATA, backwards) for _ in range(10)}
    assert len(written) == 1
    data = written.pop()
    length = int.from_bytes(data[:8], "little")
    assert length % 8 == 0  # tensors stay aligned
    assert json.loads(data[8 : 8 + length])["__metadata__"] == METADATA


def as_the_library_writes(graph: WrinkleGraph, metadata: dict[str, str] | None) -> bytes:
    """A file by the library, with sorted metadata in its header."""
    data: bytes = save(graph.arrays())
    if not metadata:
        return data
    start = 8 + int.from_bytes(data[:8], "little")
    header = {"__metadata__": dict(sorted(metadata.items())), **json.loads(data[8:start])}
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + data[start:]


@pytest.mark.parametrize("metadata", [None, {}, METADATA])
@pytest.mark.parametrize("names", [[], ["node_metric"], ["node_triangle"], list(OPTIONAL)])
def test_the_bytes_are_those_of_the_library(
    names: list[str], metadata: dict[str, str] | None
) -> None:
    """Stored graphs, and ids made of content, stay what they were."""
    graph = WrinkleGraph(**ARRAYS, **{name: OPTIONAL[name] for name in names})
    assert write_graph(graph, metadata) == as_the_library_writes(graph, metadata)


def test_a_graph_without_wrinkles_is_written() -> None:
    none = {name: array[:0] for name, array in {**ARRAYS, **OPTIONAL}.items()}
    graph = WrinkleGraph(**none)
    assert write_graph(graph) == as_the_library_writes(graph, None)


def test_pieces_are_views_of_the_arrays() -> None:
    graph = WrinkleGraph(**ARRAYS, **OPTIONAL)
    _, *pieces = graph_pieces(graph)
    assert len(pieces) == len(graph.arrays())
    for array in graph.arrays().values():
        assert any(np.shares_memory(array, np.asarray(piece)) for piece in pieces)


@given(st.integers(1, 40), st.integers(0, 60), st.integers(0, 2**31))
def test_graphs_of_any_size(pores: int, wrinkles: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    start = rng.integers(0, pores, wrinkles if pores > 1 else 0)
    end = (start + rng.integers(1, max(pores, 2), len(start))) % pores
    ring = np.linspace(0, 6, pores, endpoint=False)
    arrays = {
        "node_uv": np.stack([np.cos(ring), np.sin(ring)], axis=1).astype(np.float32),
        "node_weight": rng.random(pores, np.float32),
        "node_radius": rng.random(pores, np.float32) * np.float32(0.9) + np.float32(0.01),
        "edge_nodes": np.stack([start, end], axis=1).astype(np.int32),
        "edge_weight": rng.random(len(start), np.float32),
        "edge_half_width": np.full(len(start), 0.01, np.float32),
    }
    same_graph(read_graph(write_graph(WrinkleGraph(**arrays))), arrays)


def without(name: str) -> dict[str, Any]:
    return {key: array for key, array in ARRAYS.items() if key != name}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a readable safetensors file"),
        (b"\xff" * 64, "not a readable safetensors file"),
        (b"\x08" + bytes(7) + b"[1, 2]  ", "not a readable safetensors file"),
        (save(ARRAYS)[:-1], "not a readable safetensors file"),
        (save(ARRAYS) + b"\0", "not a readable safetensors file"),
        (save({**ARRAYS, "extra": np.zeros(1)}), "unknown tensor 'extra'; known are node_uv, "),
        *[(save(without(name)), f"the tensor {name} is missing") for name in ARRAYS],
        (save({**ARRAYS, "node_uv": np.zeros((3, 2))}), "node_uv has dtype F64, not F32"),
        (save({**ARRAYS, "edge_nodes": np.zeros((2, 2), "i8")}), "edge_nodes has dtype I64, not"),
        (save({**ARRAYS, "edge_nodes": np.zeros((2, 2), "f4")}), "edge_nodes has dtype F32, not"),
        (save({**ARRAYS, "node_uv": np.zeros((3, 3), "f4")}), r"node_uv has shape \(3, 3\)"),
        (save({**ARRAYS, "node_weight": np.zeros(2, "f4")}), "node_weight has 2 rows"),
        (save({**ARRAYS, "node_weight": -ARRAYS["node_weight"]}), r"node_weight\[1\] is -0.5"),
        (save({**ARRAYS, "edge_nodes": ARRAYS["edge_nodes"] + 1}), r"edge_nodes\[1\] is \[3, 2\]"),
    ],
)
def test_refused(data: bytes, message: str) -> None:
    with pytest.raises(GraphError, match=message):
        read_graph(data)


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("node_copy_of", [-1, 3, -1], r"node_copy_of\[1\] is 3: must be -1 or from 0 to 2"),
        ("node_copy_of", [1, -2, -1], r"node_copy_of\[1\] is -2"),
        ("edge_copy_of", [1, 0], r"edge_copy_of\[0\] is 1: must be -1 or a row that is no copy"),
        ("edge_copy_of", [0, -1], r"edge_copy_of\[0\] is 0: must be -1 or a row that is no copy"),
        ("edge_metric", [[0, 0, 0], [4, 9, 9]], r"edge_metric\[1\] is .* must be 0 or a UV metric"),
        ("edge_share", np.float32([0, 8.5]), r"edge_share\[1\] is 8.5: must be from 0 to 8"),
        ("edge_share", np.float32([1]), r"edge_share has 1 row, edge_nodes has 2"),
    ],
)
def test_what_cannot_be_is_refused(name: str, value: Any, rule: str) -> None:
    with pytest.raises(GraphError, match=rule):
        WrinkleGraph(**{**ARRAYS, name: np.array(value)})
