"""Polygons of hosts as arrays, and their units."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.lengths import MILLIMETRES as OF_SERVICE
from rhytid.formats.meshes import read_mesh
from rhytid_client.hosts import Trouble, polygons, welded
from rhytid_client.hosts.meshes import counted
from rhytid_client.hosts.units import MILLIMETRES, factor, guessed_unit

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 1], [2, 1, 0], [1, 2, 0], [0, 1, 0]], np.float32)
UV = POSITIONS[:, :2] / 2
# A pentagon, a triangle and an edge that is no face.
COUNTS, VERTICES = [5, 2, 3], [0, 1, 3, 4, 5, 0, 1, 1, 2, 3]
OBJ = "".join(
    [
        *(f"v {x} {y} {z}\n" for x, y, z in POSITIONS),
        *(f"vt {u} {v}\n" for u, v in UV),
        "f 1/1 2/2 4/4 5/5 6/6\nf 2/2 3/3 4/4\n",
    ]
)


def test_polygons_are_cut_as_the_service_cuts_those_of_a_file() -> None:
    made = polygons("face", POSITIONS, COUNTS, VERTICES, UV, VERTICES)
    read = read_mesh(OBJ.encode(), "face.obj").mesh
    assert (made["faces"] == read.faces).all()
    assert (made["uv"][made["face_uv"]] == read.triangle_uv()).all()
    assert (made["positions"] == read.positions + read.centre).all()
    kinds = {name: (array.dtype, array.shape[1]) for name, array in made.items()}
    assert kinds == {
        "positions": (np.float32, 3),
        "faces": (np.int32, 3),
        "uv": (np.float32, 2),
        "face_uv": (np.int32, 3),
    }


def test_corners_that_run_clockwise_are_turned_round() -> None:
    right = polygons("face", POSITIONS, COUNTS, VERTICES, UV, VERTICES)
    turned = polygons("face", POSITIONS, COUNTS, VERTICES, UV, VERTICES, clockwise=True)

    def normals(mesh: dict) -> np.ndarray:
        a, b, c = np.moveaxis(mesh["positions"][mesh["faces"]], 1, 0)
        return np.cross(b - a, c - a)

    assert normals(turned) == pytest.approx(-normals(right))
    assert (turned["face_uv"] == turned["faces"]).all()


@pytest.mark.parametrize("rows", [VERTICES[:-1], [-1, *VERTICES[1:]], []])
def test_corners_without_uv_are_told(rows: list[int]) -> None:
    with pytest.raises(Trouble, match="'face' has no UV map: unwrap it"):
        polygons("face", POSITIONS, COUNTS, VERTICES, UV, rows)


def test_no_faces_are_told() -> None:
    with pytest.raises(Trouble, match="'face' has no faces"):
        polygons("face", POSITIONS, [2], [0, 1], UV, [0, 1])


def test_corners_with_one_uv_at_one_vertex_share_it() -> None:
    vertices = [0, 1, 2, 0, 2, 3, 0]
    uv = [(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1), (0.5, 0)]
    values, rows = welded(vertices, uv)
    assert len(values) == 5
    assert (values[rows] == np.array(uv, np.float32)).all()
    assert rows[0] == rows[3] != rows[6]


def test_another_number_of_vertices_is_told() -> None:
    assert (counted("face", POSITIONS, 6, "") == POSITIONS).all()
    with pytest.raises(Trouble, match="'face' has 6 vertices, 7 were sent: send it again"):
        counted("face", POSITIONS, 7, "send it again")


def test_units_are_those_of_the_service() -> None:
    plain = {name: length for name, length in OF_SERVICE.items() if name.isascii()}
    assert plain == MILLIMETRES


@pytest.mark.parametrize(
    ("of_map", "of_scene", "times"),
    [
        ("mm", "cm", 0.1),
        ("cm", "m", 0.01),
        ("M", "mm", 1000.0),
        ("µm", "um", 1.0),
        ("μm", "um", 1.0),
        ("5.5cm", "m", 0.055),
        ("mm", "2.5 cm", 0.04),
        ("", "?", 1.0),
    ],
)
def test_from_the_unit_of_a_map_to_that_of_a_scene(
    of_map: str, of_scene: str, times: float
) -> None:
    assert factor(of_map, of_scene) == pytest.approx(times)


def test_an_unknown_unit_is_told() -> None:
    with pytest.raises(Trouble, match="Maps in 'px' have no known size: use one of um, mm"):
        factor("px", "cm")


@pytest.mark.parametrize(("size", "unit"), [(280.0, "mm"), (22.0, "cm"), (0.3, "m")])
def test_a_head_tells_its_unit(size: float, unit: str) -> None:
    assert guessed_unit(np.array([[0, 0, 0], [0.1, size, 0.2]])) == unit


def test_a_point_has_no_unit() -> None:
    with pytest.raises(Trouble, match="All vertices are at one place"):
        guessed_unit(np.zeros((3, 3)))
