"""Units, the lengths that follow from a spacing, and what a graph's file says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhytid.domain import lengths
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import GraphOrigin, WrinkleGraph, mesh_digest
from rhytid.domain.lengths import MILLIMETRES, Lengths, millimetres
from rhytid.domain.mesh import Mesh
from rhytid.errors import GraphError, SettingsError

# As a table of units has them, apart from ours.
METRES = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "dm": 0.1, "m": 1.0, "in": 0.0254, "ft": 0.3048}
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [1, 3, 2]])
MESH = Mesh(CORNERS, FACES, CORNERS[:, :2] * 0.7, FACES)


@pytest.mark.parametrize("unit", METRES)
def test_usual_pores_are_half_a_millimetre_apart_in_every_unit(unit: str) -> None:
    settings = AssetSettings.parse({"unit": unit}).for_synthesis()
    assert settings.graph.spacing is not None
    assert settings.graph.spacing * METRES[unit] == pytest.approx(0.5e-3)
    depth = settings.resolved(settings.graph.spacing).depth
    assert depth is not None
    assert depth * METRES[unit] == pytest.approx(75e-6)


def test_units_are_known_by_any_case_and_either_micro_sign() -> None:
    assert set(METRES) | {"\u00b5m"} == set(MILLIMETRES)
    assert millimetres("MM") == millimetres("mm") == 1.0
    assert millimetres("\u00b5m") == millimetres("\u03bcm") == 1e-3
    assert millimetres("furlong") is None


def test_an_unknown_unit_needs_a_spacing_or_a_number() -> None:
    told = r"'furlong'.*set graph.spacing .*graph.wrinkles.* mm"
    with pytest.raises(SettingsError, match=told):
        AssetSettings.parse({"unit": "furlong"}).for_synthesis()
    for graph in ({"spacing": 2.0}, {"wrinkles": 1000}):
        asked = AssetSettings.parse({"unit": "furlong", "graph": graph})
        assert asked.for_synthesis() == replace(asked, graph=replace(asked.graph, seed=1))


def test_lengths_are_in_proportion_to_the_spacing() -> None:
    lengths = Lengths.of(0.2)
    assert lengths.depth == 0.15 * 0.2
    assert lengths.sigma == 0.25 * 0.2
    assert lengths.wave_frequency == 0.4 / 0.2


def test_a_graph_with_another_origin_has_the_same_arrays() -> None:
    node, ends = np.zeros(2, np.float32), np.array([[0, 1]], np.int32)
    uv, one = np.array([[0.1, 0.1], [0.2, 0.2]], np.float32), np.full(1, 0.1, np.float32)
    graph = WrinkleGraph(uv, node, node + np.float32(0.01), ends, one, one)
    origin = GraphOrigin("mm", seed=3)
    other = graph.with_origin(origin)
    assert (other.origin, graph.origin) == (origin, None)
    assert other.node_uv is graph.node_uv
    assert other.arrays().keys() == graph.arrays().keys()


def test_an_origin_comes_back_from_its_metadata() -> None:
    origin = GraphOrigin.of(MESH, "mm", Lengths.of(0.1 + 0.2))
    assert GraphOrigin.parse(origin.metadata()) == origin
    whole = replace(origin, grain_size=0.1, undulation_size=3.0, seed=2**31 - 1, patch_size=9.0)
    assert GraphOrigin.parse(whole.metadata()) == whole
    assert GraphOrigin.parse({"depth": "0.5", "asset": "a"}) == GraphOrigin(depth=0.5)
    assert GraphOrigin.parse({"asset": "a"}) is None


@pytest.mark.parametrize(
    ("key", "text"),
    [("depth", "0"), ("spacing", "-1"), ("sigma", "nan"), ("wave_frequency", "inf"),
     ("depth", "deep"), ("unit", ""), ("unit", 17 * "m"), ("mesh", "\n"),
     ("grain_size", "0"), ("undulation_size", "nan"), ("seed", "-1"), ("seed", "2147483648"),
     ("seed", "1.0"), ("seed", ""), ("seed", "1_0"), ("seed", "١")],
)  # fmt: skip
def test_metadata_that_cannot_be_used_are_named(key: str, text: str) -> None:
    with pytest.raises(GraphError, match=f"metadata {key} is "):
        GraphOrigin.parse({key: text})


def test_lengths_are_converted_between_units() -> None:
    origin = GraphOrigin.of(MESH, "mm", Lengths.of(0.5), 7)
    sizes = replace(origin, grain_size=0.2, undulation_size=6.0).in_unit("cm")
    assert (sizes.grain_size, sizes.undulation_size) == pytest.approx((0.02, 0.6))
    assert (sizes.seed, sizes.mesh) == (7, origin.mesh)
    found = origin.lengths("cm", 99.0)
    assert found.spacing == pytest.approx(0.05)
    assert found.depth == pytest.approx(0.0075)
    assert found.sigma == pytest.approx(0.0125)
    assert found.wave_frequency == pytest.approx(8.0)
    assert origin.lengths("mm", 99.0) == Lengths.of(0.5)


def test_what_a_file_does_not_say_follows_from_its_spacing_or_the_pores() -> None:
    assert GraphOrigin(depth=0.3).lengths("cm", 0.2) == replace(Lengths.of(0.2), depth=0.3)
    assert GraphOrigin(spacing=0.4).lengths("cm", 0.2) == Lengths.of(0.4)


def test_lengths_of_an_unknown_unit_are_taken_in_that_unit_alone() -> None:
    origin = replace(GraphOrigin.of(MESH, "mm", Lengths.of(0.5)), unit="furlong")
    assert origin.lengths("furlong", 1.0) == Lengths.of(0.5)
    for unit in ("cm", "mile"):
        with pytest.raises(SettingsError, match=f"graph is in 'furlong' and the mesh in '{unit}'"):
            AssetSettings.parse({"unit": unit}).for_graph(origin)


def test_the_unit_is_that_of_the_graph_unless_it_is_set() -> None:
    origin = GraphOrigin(unit="in")
    assert AssetSettings().for_graph(origin).unit == "in"
    assert AssetSettings.parse({"unit": "mm"}).for_graph(origin).unit == "mm"
    assert AssetSettings().for_graph(None).unit == "cm"


def test_the_digest_of_a_mesh_is_its_triangles_and_uv() -> None:
    moved = replace(MESH, positions=MESH.positions * 3 + 1)
    welded_otherwise = Mesh(CORNERS, FACES, MESH.uv[[3, 2, 1, 0]], 3 - FACES)
    float32 = replace(MESH, uv=MESH.uv.astype(np.float32))
    assert {mesh_digest(m) for m in (moved, welded_otherwise, float32)} == {mesh_digest(MESH)}
    turned = Mesh(CORNERS, FACES[:, ::-1], MESH.uv, FACES[:, ::-1])
    shifted = replace(MESH, uv=MESH.uv + 0.01)
    for other in (turned, shifted):
        with pytest.raises(GraphError, match="made for another mesh"):
            GraphOrigin.of(MESH, "cm", Lengths.of(1.0)).check_mesh(other)


@pytest.mark.parametrize(
    ("unit", "length"),
    [
        ("cm", 10.0), ("5.5cm", 55.0), ("5.5 cm", 55.0), (".5in", 12.7), ("1e-1m", 100.0),
        ("2µm", 0.002), ("2Μm", 0.002), ("10MM", 10.0), ("0cm", None), ("5,5cm", None),
        ("-1cm", None), ("5.5", None), ("5.5furlong", None), ("1e99m", None), ("٣cm", None),
    ],
)  # fmt: skip
def test_a_unit_is_a_name_or_so_many_of_one(unit: str, length: float | None) -> None:
    assert millimetres(unit) == (length if length is None else pytest.approx(length))


def test_a_counted_unit_makes_lengths_of_skin() -> None:
    settings = AssetSettings.parse({"unit": "5.5cm"})
    assert settings.for_synthesis().graph.spacing == pytest.approx(0.5 / 55)
    assert settings.resolved(0.5 / 55).as_json()["unit"] == "5.5cm"
    graph = GraphOrigin("cm", depth=1.1).in_unit("5.5cm")
    assert graph.depth == pytest.approx(0.2)


def test_a_unit_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    read, parts = [], lengths._parts
    monkeypatch.setattr(lengths, "_parts", lambda unit: read.append(unit) or parts(unit))
    assert [millimetres("7.125cm"), millimetres("7.125cm")] == [71.25, 71.25]
    assert read == ["7.125cm"]
