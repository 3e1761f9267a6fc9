"""What differs from place to place: each field does what it says, and where it says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.graph import WrinkleGraph
from rhytid.synthesis.fields import Directions, Fields, looked_up
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.lattice import Around, Lattice, spatial_order
from rhytid.synthesis.progress import silent
from rhytid.synthesis.surface import Points
from rhytid.synthesis.trails import FINE, Paths, wear
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

COUNT = 4000
# More than a thread has at a time.
MANY = 150_000


class Right(Fields):
    """One field with another value right of the middle of the map."""

    def __init__(self, name: str, value: float) -> None:
        even = getattr(Fields, name)

        def found(triangle: NDArray[Any], uv: NDArray[Any]) -> NDArray[np.float32]:
            left = even(self, triangle, uv)
            return np.where(uv[:, 0] > 0.5, np.float32(value), left).astype(np.float32)

        setattr(self, name, found)


def grown(device: Device, fields: Fields) -> WrinkleGraph:
    return synthesize(sheets.sheet(), sheets.wanted(COUNT), device, fields=fields).graph


@pytest.fixture(scope="module")
def even(device: Device) -> WrinkleGraph:
    return grown(device, Fields())


def sides(graph: WrinkleGraph) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Wrinkles wholly left and wholly right of the middle of the map, with a margin."""
    u = graph.node_uv[graph.edge_nodes, 0]
    return (u < 0.45).all(axis=1), (u > 0.55).all(axis=1)


def test_strength_scales_weights(device: Device, even: WrinkleGraph) -> None:
    graph = grown(device, Right("strength", 0.5))
    left, right = sides(even)
    assert (graph.edge_nodes == even.edge_nodes).all()
    assert graph.edge_weight[right] == pytest.approx(0.5 * even.edge_weight[right], rel=1e-6)
    assert (graph.edge_weight[left] == even.edge_weight[left]).all()
    assert (graph.edge_half_width == even.edge_half_width).all()
    far = even.node_uv[:, 0] > 0.55
    assert graph.node_weight[far] == pytest.approx(0.5 * even.node_weight[far], rel=0.01)


@pytest.mark.parametrize("value", [0.0, 100.0])
def test_weights_stay_in_range(device: Device, value: float) -> None:
    graph = grown(device, Right("strength", value))
    for weight in (graph.edge_weight, graph.node_weight):
        assert 0 < weight.min() <= weight.max() <= 1


def test_width_and_pore_radius_scale_sizes(device: Device, even: WrinkleGraph) -> None:
    wide, large = grown(device, Right("width", 2.0)), grown(device, Right("pore_radius", 2.0))
    left, right = sides(even)
    assert wide.edge_half_width[right] == pytest.approx(2 * even.edge_half_width[right], rel=1e-6)
    assert (wide.edge_half_width[left] == even.edge_half_width[left]).all()
    u = even.node_uv[:, 0]
    assert large.node_radius[u > 0.5] == pytest.approx(2 * even.node_radius[u > 0.5], rel=1e-6)
    assert (large.node_radius[u < 0.5] == even.node_radius[u < 0.5]).all()


def test_turn_turns_directions_left(device: Device) -> None:
    pores = sheets.scattered(device, sheets.sheet(), 0.05)
    fields = (Fields(), Right("turn", np.pi / 2))
    (along, left), turned = (
        Directions(0.05, np.random.default_rng(1), field).frames(pores, silent) for field in fields
    )
    there = pores.uv[:, 0] > 0.5
    assert turned[0][there] == pytest.approx(left[there], abs=1e-5)
    assert turned[1][there] == pytest.approx(-along[there], abs=1e-5)
    assert (turned[0][~there] == along[~there]).all()


def test_main_lines_slant_to_the_right_of_preferred_ones(device: Device) -> None:
    pores = sheets.scattered(device, sheets.sheet(), 0.05)
    fields = (Fields(), Right("slant", np.radians(36.0)))
    (along, left), slanting = (
        Directions(0.05, np.random.default_rng(1), field).frames(pores, silent) for field in fields
    )
    there = pores.uv[:, 0] > 0.5
    cosine, sine = np.cos(np.radians(36.0)), np.sin(np.radians(36.0))
    wanted = cosine * along[there] - sine * left[there]
    assert slanting[0][there] == pytest.approx(wanted, abs=1e-5)
    assert (slanting[0][~there] == along[~there]).all()


def test_without_anisotropy_walkers_go_every_way(device: Device) -> None:
    pores, edges = sheets.net(device, sheets.sheet(), 0.03)
    along, left = (np.tile(axis.astype(np.float32), (len(pores), 1)) for axis in np.eye(3)[:2])
    way = pores.position[edges.nodes[:, 1]] - pores.position[edges.nodes[:, 0]]
    level = np.abs(way[:, 0]) > 0.97 * np.linalg.norm(way, axis=-1)
    lattice, shares = Lattice.absolute(0.03, np.zeros(3), np.ones(3)), []
    for anisotropy in (Fields(), Right("anisotropy", 0.0)):
        with Workspace(device) as work:
            found = anisotropy.anisotropy(pores.triangle, np.ones((len(pores), 2)))
            paths = Paths.of(work, pores, edges, along, left, found, lattice, 0.04)
            strength = wear(work, paths, np.empty((0, 2), np.int32), 2, 2.86, FINE, silent)
        shares.append(strength[level].mean() / strength.mean())
    assert shares[0] > 1.3
    assert 0.8 < shares[1] < 1.15


def many_points() -> Points:
    rng = np.random.default_rng(3)
    uv, position = rng.random((MANY, 2)).astype(np.float32), rng.normal(size=(MANY, 3))
    return Points(rng.integers(99, size=MANY), uv, position, position.astype(np.float32))


def test_many_points_are_looked_up_on_all_cores_in_their_order() -> None:
    points = many_points()

    def look(triangle: NDArray[Any], uv: NDArray[Any]) -> NDArray[np.float32]:
        assert len(triangle) == len(uv) < MANY
        return triangle.astype(np.float32) + uv[:, 1]

    wanted = points.triangle.astype(np.float32) + points.uv[:, 1]
    np.testing.assert_array_equal(looked_up(look, points), wanted)


def test_a_lattice_holds_all_of_many_points_and_no_more() -> None:
    position = many_points().position
    for row in (0, MANY - 1):
        position[row] = [-9.0, 40.0, -20.0] if row else [7.0, -4.0, 30.0]
    lattice = Lattice.around(position)
    np.testing.assert_array_equal(lattice.origin, position.min(axis=0))
    assert lattice.unit == 2.0 ** (6 - 30)


def test_many_places_are_near_as_each_alone_is() -> None:
    places = many_points().position
    around = Around(places[:40], 0.05)
    np.testing.assert_array_equal(around.all_near(places), around.near(places))
    apart = np.linalg.norm(places[:, None, :] - places[:40], axis=-1).min(axis=1)
    assert np.isin(np.flatnonzero(apart <= 0.05), around.all_near(places)).all()
    assert len(around.all_near(places)) < 0.2 * MANY


def test_places_are_in_the_order_of_the_curve_and_then_of_their_numbers() -> None:
    """Two in one cell of the curve come in the order of their places, whichever stands first."""
    places = np.random.default_rng(4).integers(0, 1 << 30, (MANY, 3)).astype(np.int32)
    places[7] = places[MANY - 1] ^ np.int32(1)  # in the same cell of 2^9 steps
    code = np.zeros(MANY, object)
    for bit in range(21):
        for axis in range(3):
            set_here = (places[:, axis] >> (bit + 9)) & 1
            code += set_here.astype(object) << (3 * bit + axis)
    wanted = np.lexsort((*places.T, code.astype(np.uint64)))
    np.testing.assert_array_equal(spatial_order(places), wanted)
