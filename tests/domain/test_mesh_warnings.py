"""What a mesh is warned of, on both sides of every limit."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import face_data
from meshes import SmallMesh
from rhytid.domain import warnings as limits
from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import mesh_warnings
from rhytid.formats.meshes import read_mesh
from rhytid_lab.samples.face import procedural_face
from rhytid_lab.samples.sphere import sphere

FACE = procedural_face(32).mesh
RIGHT = np.array([1, 0])


def codes(mesh: Mesh, unit: str = "cm", resolution: int = 4096) -> list[str]:
    return [warning.code for warning in mesh_warnings(mesh, unit, resolution)]


def with_uv(mesh: Mesh, change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Mesh:
    return replace(mesh, uv=change(mesh.uv.copy()))


def real_face() -> Mesh:
    face = face_data.load_face()
    return Mesh(face.positions, face.faces, face.uv, face.face_uv)


@pytest.mark.parametrize(
    "make",
    [lambda: FACE, lambda: procedural_face().mesh, sphere],
    ids=["32", "96", "ball"],
)
def test_the_samples_are_as_they_should_be(make: Callable[[], Mesh]) -> None:
    assert codes(make()) == []


def test_a_flat_sheet_is_not_inside_out(small_mesh: SmallMesh) -> None:
    """It has no outside: the way out lies in it."""
    assert codes(Mesh(*small_mesh), "ft") == codes(Mesh(*small_mesh), "no known unit") == []


@pytest.mark.parametrize(
    ("unit", "said"),
    [("mm", "'cm'"), ("m", "'cm'"), ("ft", "'cm'")],
)
def test_a_head_in_the_wrong_unit(unit: str, said: str) -> None:
    (found,) = mesh_warnings(FACE, unit, 1024)
    assert found.code == limits.MESH_SIZE
    assert said in found.detail
    assert unit in found.detail


def test_a_body_is_told_to_measure_its_head() -> None:
    scale = 175 / np.ptp(FACE.positions.astype(float), axis=0).max()
    body = replace(FACE, positions=FACE.positions * np.float32(scale))
    (found,) = mesh_warnings(body, "cm", 1024)
    assert found.code == limits.MESH_SIZE
    assert "1.75 m across (175 cm)" in found.detail
    assert "if it is the head alone, in the unit 'mm' it would be 17.5 cm" in found.detail
    assert "shoulders or a body belong to it, measure the head" in found.detail


def test_sizes_in_a_counted_unit_are_told_as_such() -> None:
    (found,) = mesh_warnings(FACE, "5.5cm", 1024)
    assert re.search(r"m across \([0-9.]+ x 5.5cm\)", found.detail)


@pytest.mark.parametrize(
    ("size", "warned"),
    [
        (0.99 * limits.LEAST_SIZE, True),
        (1.01 * limits.LEAST_SIZE, False),
        (0.99 * limits.MOST_SIZE, False),
        (1.01 * limits.MOST_SIZE, True),
    ],
)
def test_sizes_of_faces(size: float, warned: bool) -> None:
    scale = size / 10 / np.ptp(FACE.positions.astype(float), axis=0).max()
    scaled = replace(FACE, positions=FACE.positions * np.float32(scale))
    assert codes(scaled) == ([limits.MESH_SIZE] if warned else [])


def test_of_a_unit_that_is_not_known_nothing_is_said() -> None:
    assert codes(FACE, "parsec") == []


def test_a_uv_folded_in_half() -> None:
    folded = with_uv(FACE, lambda uv: np.stack([np.abs(uv[:, 0] - 0.5), uv[:, 1]], axis=1))
    found = {w.code: w for w in mesh_warnings(folded, "cm", 4096)}
    assert set(found) == {limits.UV_OVERLAP, limits.UV_MIRRORED}
    assert "UDIM 1001" in found[limits.UV_OVERLAP].where
    assert "99" in found[limits.UV_OVERLAP].detail or "100" in found[limits.UV_OVERLAP].detail
    assert "50" in found[limits.UV_MIRRORED].detail


@pytest.mark.parametrize(("factor", "warned"), [(0.8, False), (1.2, True)])
def test_the_share_that_overlaps(factor: float, warned: bool) -> None:
    """One more triangle, over the face, in a UDIM that is full but for a margin."""
    area = _uv_area(FACE)
    side = np.sqrt(2 * factor * limits.OVERLAP_SHARE * area)
    patch = np.array([[0.5, 0.5], [0.5 + side, 0.5], [0.5, 0.5 + side]])
    uv = np.concatenate([FACE.uv, patch])
    # It lies beside the face in space, as large there as texels are elsewhere.
    scale = np.sqrt(_area(FACE) / area)
    there = np.c_[(patch - patch[0]) * scale, np.zeros(3)] + FACE.positions.mean(axis=0)
    count = len(FACE.positions)
    mesh = Mesh(
        np.concatenate([FACE.positions, there]),
        np.concatenate([FACE.faces, [[count, count + 1, count + 2]]]),
        uv,
        np.concatenate([FACE.face_uv, [[len(uv) - 3, len(uv) - 2, len(uv) - 1]]]),
    )
    assert codes(mesh) == ([limits.UV_OVERLAP] if warned else [])


def test_an_overlap_is_told_of_its_udim() -> None:
    doubled = Mesh(
        np.concatenate([FACE.positions] * 3),
        np.concatenate([FACE.faces + i * len(FACE.positions) for i in range(3)]),
        np.concatenate([FACE.uv, FACE.uv + RIGHT, FACE.uv + RIGHT]),
        np.concatenate([FACE.face_uv + i * len(FACE.uv) for i in range(3)]),
    )
    (found,) = mesh_warnings(doubled, "cm", 4096)
    assert found.code == limits.UV_OVERLAP
    assert found.where.startswith("UDIM 1002")


def test_a_mirrored_uv_and_a_mesh_inside_out_are_told_apart() -> None:
    mirrored = with_uv(FACE, lambda uv: uv * [-1, 1] + [1, 0])
    inside_out = replace(FACE, faces=FACE.faces[:, ::-1], face_uv=FACE.face_uv[:, ::-1])
    both = replace(mirrored, faces=FACE.faces[:, ::-1], face_uv=FACE.face_uv[:, ::-1])
    assert codes(mirrored) == [limits.UV_MIRRORED]
    assert "flip v" in mesh_warnings(mirrored, "cm", 4096)[0].detail
    assert codes(inside_out) == [limits.NORMALS_INWARD]
    assert codes(both) == [limits.NORMALS_INWARD, limits.UV_MIRRORED]


@pytest.mark.parametrize(("factor", "warned"), [(0.7, False), (1.3, True)])
def test_the_share_that_is_mirrored(factor: float, warned: bool) -> None:
    """Triangles cut off and laid down mirrored in a UDIM of their own."""
    corners = FACE.triangle_uv()
    u, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0])
    count = int(np.searchsorted(np.cumsum(areas), factor * limits.MIRRORED_SHARE * areas.sum()))
    uv = corners.reshape(-1, 2).copy()
    uv[: 3 * count, 0] = 2.0 - uv[: 3 * count, 0]
    mesh = Mesh(FACE.positions, FACE.faces, uv, np.arange(len(uv)).reshape(-1, 3))
    assert codes(mesh) == ([limits.UV_MIRRORED] if warned else [])
    assert all("flip these" in found.detail for found in mesh_warnings(mesh, "cm", 4096))


@pytest.mark.parametrize(("ratio", "warned"), [(0.65, False), (1.25, True)])
def test_texels_of_one_place_are_too_large(ratio: float, warned: bool) -> None:
    """A tenth of the face has all the room it needs, the rest a tenth of that, along u and v."""
    ratio *= limits.TEXEL_RATIO
    middles = FACE.positions[FACE.faces].mean(axis=1)
    few = middles[:, 1] > np.quantile(middles[:, 1], 0.9)
    uv = FACE.triangle_uv() / ratio
    uv[few] = FACE.triangle_uv()[few] + [1.0, 0.0]
    mesh = Mesh(
        FACE.positions, FACE.faces, uv.reshape(-1, 2), np.arange(3 * len(uv)).reshape(-1, 3)
    )
    found = mesh_warnings(mesh, "cm", 4096)
    assert [w.code for w in found] == ([limits.TEXEL_SIZE] if warned else [])
    assert not warned or "mm" in found[0].detail


@pytest.mark.parametrize(
    ("share", "told"),
    [
        ((9.0, 0.6, 1.6), "here and at 1 more place."),
        ((9.0, 1.6, 1.6, 1.6), "here and at 3 more places."),
        ((9.0,), "here."),
    ],
)
def test_other_places_are_counted(share: tuple[float, ...], told: str) -> None:
    """Places of so many thousandths of the face; one of less than a thousandth is not counted."""
    (found,) = mesh_warnings(_with_coarse_places(share), "cm", 4096)
    assert found.code == limits.TEXEL_SIZE
    assert told in found.detail


def _with_coarse_places(thousandths: tuple[float, ...]) -> Mesh:
    """Around vertices far apart as many triangles as have that share of the area, with a twentieth
    of their room in UV."""
    middles = FACE.positions[FACE.faces].mean(axis=1)
    corners = FACE.positions[FACE.faces].astype(float)
    areas = np.linalg.norm(np.cross(*np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)), axis=1)
    spots = [[-4, -6], [4, -6], [-4, 4], [4, 4]]
    uv = FACE.triangle_uv().copy()
    for spot, share in zip(spots, thousandths, strict=False):
        near = np.argsort(np.linalg.norm(middles[:, :2] - spot, axis=1))
        few = near[: np.searchsorted(np.cumsum(areas[near]), share * areas.sum() / 1000) + 1]
        uv[few] = uv[few].mean(axis=1, keepdims=True) * 0.95 + uv[few] * 0.05
    return Mesh(
        FACE.positions, FACE.faces, uv.reshape(-1, 2), np.arange(3 * len(uv)).reshape(-1, 3)
    )


def test_slivers_are_no_texels() -> None:
    """A few triangles with hardly any UV: less than half a hundredth of the surface."""
    corners = FACE.triangle_uv().copy()
    corners[:3] = corners[:3, :1] + 1e-3 * (corners[:3] - corners[:3, :1])
    mesh = Mesh(
        FACE.positions,
        FACE.faces,
        corners.reshape(-1, 2),
        np.arange(corners.size // 2).reshape(-1, 3),
    )
    assert codes(mesh) == []


@pytest.mark.parametrize(("factor", "warned"), [(0.4, False), (2.5, True)])
def test_float32_far_from_the_origin(factor: float, warned: bool) -> None:
    edge = np.median(np.linalg.norm(np.diff(FACE.positions[FACE.faces[:, :2]], axis=1), axis=-1))
    far = float(factor * limits.STEP_OF_EDGE * edge * 2**23)
    moved = FACE.positions.astype(np.float64) + np.array([far, 0, 0])
    assert codes(replace(FACE, positions=moved.astype(np.float32))) == (
        [limits.FAR_FROM_ORIGIN] if warned else []
    )
    assert codes(Mesh.centred(moved, FACE.faces, FACE.uv, FACE.face_uv)) == []


def test_places_are_those_that_were_sent() -> None:
    moved = FACE.positions.astype(np.float64) + np.array([1e5, 0, 0])
    mirrored = Mesh.centred(moved, FACE.faces, FACE.uv * [-1, 1] + [1, 0], FACE.face_uv)
    (found,) = mesh_warnings(mirrored, "cm", 4096)
    assert "at (9999" in found.where


@pytest.mark.face
def test_the_real_face_has_coarse_nostrils_alone() -> None:
    """Its texels are 0.05 to 1 mm at 4096²: 18 times apart, the widest in the nostrils."""
    (found,) = mesh_warnings(real_face(), "cm", 4096)
    assert found.code == limits.TEXEL_SIZE
    assert "18 times apart" in found.detail
    assert "here and at 1 more place." in found.detail
    x, y, z = (float(v) for v in found.where.split("at (")[1].split(")")[0].split(","))
    assert abs(x) < 2
    assert abs(y) < 2
    assert 9 < z < 12


@pytest.mark.face
@pytest.mark.parametrize(
    ("place", "wanted"),
    [
        ("mediapipe_tiny/canonical_face_model.obj", []),
        (
            "lee_perry_smith/LeePerrySmith.glb",
            [limits.MESH_SIZE, limits.UV_MIRRORED, limits.TEXEL_SIZE],
        ),
    ],
)
def test_other_heads(place: str, wanted: list[str]) -> None:
    """The scan is 8.6 of no unit tall and its scalp has no room. Its v points up, unlike that of
    glTF, so that what is read runs against its winding."""
    file = Path(face_data.folder()) / place
    assert codes(read_mesh(file.read_bytes(), file.name).mesh) == wanted


def _area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.positions[mesh.faces].astype(float), 1, 0)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _uv_area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.triangle_uv(), 1, 0)
    u, w = b - a, c - a
    return float(0.5 * np.abs(u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]).sum())
