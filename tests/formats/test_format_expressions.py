"""Expressions in npz, npy and glTF: what is read, what is refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from formats.writers import SQUARE, SQUARE_FACES, SQUARE_UV, glb, gltf, npy, npz
from rhytid.domain.mesh import Mesh
from rhytid.errors import FrameError, LimitError, MeshError
from rhytid.formats.frames import read_expressions
from rhytid.formats.meshes import read_mesh

SHAPES = np.stack([SQUARE, SQUARE * np.float32([0.8, 1, 1]), SQUARE + np.float32(0.5)])
NAMES = np.array(["neutral", "mouthPucker", "jawOpen"])
MESH = {"positions": SQUARE, "faces": SQUARE_FACES, "uv": SQUARE_UV, "face_uv": SQUARE_FACES}
NEUTRAL = Mesh(SQUARE, SQUARE_FACES, SQUARE_UV, SQUARE_FACES)
IMAGE_UV = (SQUARE_UV * (1, -1) + (0, 1)).astype(np.float32)
OFFSETS = (SHAPES[1:] - SQUARE).astype(np.float32)


@pytest.mark.parametrize(
    ("data", "name", "names"),
    [
        (npz(shapes=SHAPES, names=NAMES), "a.npz", tuple(NAMES)),
        (npz(shapes=SHAPES.astype(np.float64)), "A.NPZ", ("0000", "0001", "0002")),
        (npz(frames=SHAPES), "a.npz", ("0000", "0001", "0002")),
        (npy(SHAPES), "a.npy", ("0000", "0001", "0002")),
    ],
)
def test_shapes_and_frames_are_read(data: bytes, name: str, names: tuple[str, ...]) -> None:
    found = read_expressions(data, name, NEUTRAL)
    np.testing.assert_array_equal(found.positions, SHAPES)
    assert found.names == names


def bad(value: float) -> Any:
    shapes = SHAPES.copy()
    shapes[2, 1, 0] = value
    return shapes


@pytest.mark.parametrize(
    ("data", "name", "told"),
    [
        (npz(shapes=SHAPES[:, :3]), "a.npz", r"shape \(3, 3, 3\).*\(E, 4, 3\)"),
        (npz(shapes=bad(np.nan), names=NAMES), "a.npz", "shape jawOpen, vertex 1 is .*not finite"),
        (npz(shapes=SHAPES, names=NAMES[:2]), "a.npz", "2 names for 3 shapes"),
        (npz(shapes=SHAPES, names=np.arange(3)), "a.npz", "names has dtype '<i8': must be text"),
        (npz(shapes=SHAPES, names=NAMES[None]), "a.npz", r"names have shape \(1, 3\)"),
        (npz(other=SHAPES), "a.npz", "neither 'shapes' nor 'frames'; it has 'other'"),
        (npz(shapes=NAMES), "a.npz", "shapes holds text"),
        (npy(bad(np.inf)), "a.npy", "not finite"),
        (npz(shapes=SHAPES - SQUARE), "a.npz", "no shape is 20 % .*not offsets"),
        (npz(frames=SHAPES - SQUARE), "a.npz", "not offsets"),
        (npy(SHAPES - SQUARE), "a.npy", "not offsets"),
        (b"v 0 0 0", "a.obj", "extension '.obj': must be one of .npz, .npy"),
    ],
)
def test_what_cannot_be_used_is_told(data: bytes, name: str, told: str) -> None:
    with pytest.raises(FrameError, match=told):
        read_expressions(data, name, NEUTRAL)


def test_shapes_of_a_mesh_go_before_its_frames() -> None:
    both = read_mesh(npz(**MESH, frames=SHAPES[:1], shapes=SHAPES, names=NAMES), "m.npz")
    frames = read_mesh(npz(**MESH, frames=SHAPES[:2]), "m.npz")
    neither = read_mesh(npz(**MESH), "m.npz")
    assert both.expressions is not None
    assert both.expressions.names == tuple(NAMES)
    assert both.frames is not None
    assert len(both.frames) == 1
    assert frames.expressions is not None
    assert len(frames.expressions) == 2
    assert neither.expressions is None


def document(targets: list[dict[str, Any]], extras: Any = None, **more: Any) -> dict[str, Any]:
    """A square whose accessors 3 and 4 are the offsets of two morph targets."""
    arrays = {
        "POSITION": SQUARE, "TEXCOORD_0": IMAGE_UV, "indices": SQUARE_FACES.reshape(-1, 1),
        "one": OFFSETS[0], "two": OFFSETS[1], "places": np.array([[1], [3]], np.uint16),
        "values": np.ones((2, 3), np.float32),
    }  # fmt: skip
    arrays["indices"] = arrays["indices"].astype(np.uint16)
    made = gltf(arrays, targets=targets)
    attributes = made["meshes"][0]["primitives"][0]["attributes"]
    for name in ("one", "two", "places", "values"):
        del attributes[name]
    if extras is not None:
        made["meshes"][0]["extras"] = extras
    made["accessors"].append({"componentType": 5126, "type": "VEC3", "count": 4, **more})
    return made


SPARSE = {
    "count": 2,
    "indices": {"bufferView": 5, "componentType": 5123},
    "values": {"bufferView": 6},
}
BOTH = [{"POSITION": 3}, {"POSITION": 4, "NORMAL": 4}]


def test_morph_targets_are_expressions() -> None:
    for data, name in (
        (json.dumps(document(BOTH)).encode(), "m.gltf"),
        (glb(document(BOTH, {"targetNames": ["pucker", "jaw"]})), "m.glb"),
    ):
        found = read_mesh(data, name).shapes
        assert found is not None
        np.testing.assert_array_equal(found.positions, SQUARE + OFFSETS)
        assert found.names == (("0000", "0001") if name == "m.gltf" else ("pucker", "jaw"))
    assert read_mesh(glb(document([])), "m.glb").shapes is None
    assert read_mesh(glb(document([{"NORMAL": 3}])), "m.glb").shapes is None


def test_sparse_targets_are_read() -> None:
    wanted = SQUARE.copy()
    wanted[[1, 3]] += 1.0
    found = read_mesh(glb(document([{"POSITION": 7}], sparse=SPARSE)), "m.glb").shapes
    assert found is not None
    np.testing.assert_array_equal(found.positions[0], wanted)
    found = read_mesh(glb(document([{"POSITION": 7}])), "m.glb").shapes
    assert found is not None
    np.testing.assert_array_equal(found.positions[0], SQUARE)


@pytest.mark.parametrize(
    ("targets", "more", "told"),
    [
        ([{"POSITION": 9}], {}, r"target 0 POSITION: no accessors\[9\]"),
        ([{"POSITION": 1}], {}, "must be VEC3 of float32"),
        ([{"POSITION": 7}], {"count": 3}, "target 0 has 3 vertices, the mesh has 4"),
        ([3], {}, "target 0: expected an object"),
        ([{"POSITION": 7}], {"sparse": {**SPARSE, "indices": {"bufferView": 5}}}, "unsigned"),
        (
            [{"POSITION": 7}],
            {"sparse": {**SPARSE, "indices": {"bufferView": 4, "componentType": 5125}}},
            "no element",
        ),
    ],
)
def test_targets_that_cannot_be_used_are_told(
    targets: list[Any], more: dict[str, Any], told: str
) -> None:
    with pytest.raises(MeshError, match=told):
        read_mesh(glb(document(targets, **more)), "m.glb")


def test_targets_beyond_the_limit_are_refused_before_they_are_made() -> None:
    with pytest.raises(LimitError, match="target 0 POSITION holds"):
        read_mesh(glb(document([{"POSITION": 7}], count=1 << 30)), "m.glb")
