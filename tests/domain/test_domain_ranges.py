"""The smallest and the largest that graphs and settings may hold."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import LEAST_SIZE, WrinkleGraph
from rhytid.errors import GraphError, SettingsError


def graph(**changes):
    arrays = {
        "node_uv": [[0.0, 0.0], [1e-3, 0.0], [0.5, 0.5]],
        "node_weight": [1.0, 1.0, 1.0],
        "node_radius": [0.01, 0.01, 0.01],
        "edge_nodes": [[0, 1], [1, 2]],
        "edge_weight": [1.0, 1.0],
        "edge_half_width": [0.01, 0.01],
    }
    given = {**arrays, **changes}
    ints = {"edge_nodes"}
    return WrinkleGraph(
        **{k: np.array(v, np.int32 if k in ints else "f4") for k, v in given.items()}
    )


def metric_of(wide, slim, angle):
    c, s, a, b = np.cos(angle), np.sin(angle), wide**-2.0, slim**-2.0
    return [a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c]


@pytest.mark.parametrize("size", [1e-25, 0.9 * LEAST_SIZE, 0.0, -1.0, 1.1])
def test_radii_and_half_widths_out_of_range_are_refused(size):
    with pytest.raises(GraphError, match=r"node_radius\[1\] .* from 1e-09 to 1"):
        graph(node_radius=[0.01, size, 0.01])
    with pytest.raises(GraphError, match=r"edge_half_width\[1\] .* from 1e-09 to 1"):
        graph(edge_half_width=[0.01, size])


def test_the_least_radius_half_width_and_length_are_taken():
    least = np.float32(LEAST_SIZE)
    graph(node_radius=[least] * 3, edge_half_width=[least] * 2)
    graph(node_uv=[[0, 0], [1.01e-9, 0], [0.5, 0.5]])


def test_wrinkles_too_short_to_be_squared_are_refused():
    with pytest.raises(GraphError, match=r"edge_nodes\[0\] is \[0, 1\]: .* 1e-09 apart"):
        graph(node_uv=[[0, 0], [1e-22, 0], [0.5, 0.5]])


def test_what_is_wrong_is_named_in_any_block_of_rows(monkeypatch):
    monkeypatch.setattr("rhytid.domain.graph._ROWS", 2)
    with pytest.raises(GraphError, match=r"node_weight\[2\] is 2\.0"):
        graph(node_weight=[1, 1, 2])
    nodes = [[0, 1], [1, 2], [0, 2], [2, 2]]
    with pytest.raises(GraphError, match=r"edge_nodes\[3\] is \[2, 2\]"):
        graph(edge_nodes=nodes, edge_weight=[1] * 4, edge_half_width=[0.01] * 4)


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, 2.0])
def test_metrics_are_read_to_the_last_digit_that_counts(angle):
    for wide, slim in ((0.9, 1e-3), (1e-6, 2e-9), (0.05, 5e-5)):
        graph(node_metric=[metric_of(wide, slim, angle)] * 3)
    for wide, slim in ((0.01, 1e-12), (1.1, 1e-3), (5e-10, 5e-10)):
        with pytest.raises(GraphError, match=r"node_metric\[2\] .* radii from 1e-09 to 1"):
            graph(node_metric=[metric_of(0.01, 0.01, 0.0)] * 2 + [metric_of(wide, slim, angle)])


@pytest.mark.parametrize("metric", [[-1, 0, -1], [0, 0, 0], [4, 4, 4], [4, 5, 4], [-4, 0, 4]])
def test_what_is_not_positive_definite_is_no_metric(metric):
    with pytest.raises(GraphError, match=r"node_metric\[0\] .* positive definite"):
        graph(node_metric=[metric] * 3)


@pytest.mark.parametrize("depth", [1e-30, 1e-20, 1e30])
def test_depths_of_very_small_and_very_large_meshes_are_taken(depth):
    assert AssetSettings.parse({"depth": depth}).depth == depth


@pytest.mark.parametrize("depth", [0.0, 9e-31, 1.1e30])
def test_depths_beyond_them_are_refused(depth):
    with pytest.raises(SettingsError, match=r"depth is .* from 1e-30 to 1e\+30"):
        AssetSettings.parse({"depth": depth})


@pytest.mark.parametrize(
    ("given", "hint"),
    [
        ({"graph.age": 65}, '{"graph": {"age": 65}}'),
        ({"shape.cushion": None}, '{"shape": {"cushion": null}}'),
        ({"graph.agee": 65}, '{"graph": {"agee": 65}}'),
    ],
)
def test_a_dotted_name_is_answered_with_its_nesting(given, hint):
    with pytest.raises(SettingsError) as refused:
        AssetSettings.parse(given)
    (name,) = given
    assert str(refused.value) == f"unknown setting {name}: settings are nested, as {hint}"


@pytest.mark.parametrize(("resolution", "tile"), [(256, 256), (512, 512), (4096, 512)])
def test_the_usual_tile_size_follows_the_resolution(resolution, tile):
    assert AssetSettings.parse({"resolution": resolution}).tile_size == tile
    assert AssetSettings.parse({"resolution": resolution, "tile_size": 64}).tile_size == 64


def test_a_tile_size_that_is_given_is_not_changed():
    with pytest.raises(SettingsError, match="tile_size 512 is above the resolution"):
        AssetSettings.parse({"resolution": 256, "tile_size": 512})
