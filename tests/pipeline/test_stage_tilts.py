"""Tilts: where in its bin the wrinkle of a texel runs; and samples that reach past `r_max`."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.binned import BinnedScene
from pipeline.scenes import DEPTH, random_graph, settings_of, sheet
from reference import bins as reference
from reference import drawing
from rhytid.domain.graph import WrinkleGraph
from rhytid.errors import SettingsError
from rhytid.pipeline.bins import sample_stretches

AT = (64, 128)
GRAPH = random_graph(24, 200)
TILTED = {"depth_factored": True, "tilt": True}


def furrow(angle):
    """A furrow through the middle of the tile; its ends are no pores."""
    middle = np.array([(AT[1] + 32.5) / 256, 1 - (AT[0] + 32.5) / 256])
    along = 0.1 * np.array([np.sin(angle), np.cos(angle)])
    return WrinkleGraph(
        node_uv=np.stack([middle - along, middle + along]).astype(np.float32),
        node_weight=np.zeros(2, np.float32),
        node_radius=np.full(2, 0.01, np.float32),
        edge_nodes=np.array([[0, 1]], np.int32),
        edge_weight=np.ones(1, np.float32),
        edge_half_width=np.full(1, 0.04, np.float32),
    )


@pytest.mark.parametrize("bulge", [1.0, 2.5])
@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("count", [2, 4, 16])
def test_tilts_are_those_of_the_reference_where_there_is_height(device, count, bits, bulge):
    shape = {"wrinkle_bulge": bulge}
    settings = settings_of(bins={**TILTED, "count": count, "bits": bits}, shape=shape)
    made = BinnedScene(device, sheet(), GRAPH, settings)
    most, compared, largest = 2 ** (bits - 1) - 1, 0, 0
    for layer, codes in enumerate(made.tilts()):
        wanted = reference.tilts(
            made.points, made.graph, layer, settings.response, settings.shape, settings.bins
        )
        high = np.abs(made.codes()[layer, -1, 0]) > 0.05 * most
        # Heights are drawn within 1e-4 of the depth, and a height of 0.06 is divided by.
        bound = 0.5 + most * 2 * 1e-4 / (0.05 * reference.TILT_SHARE)
        assert np.abs(codes - wanted * most)[high].max(initial=0) <= bound
        largest = max(largest, np.abs(codes[high]).max(initial=0))
        compared += high.sum()
    assert compared > 500
    assert largest > (0.9 if bulge > 1.0 else 0.85) * most


@pytest.mark.parametrize("share", [-0.9, -0.35, 0.0, 0.5])
@pytest.mark.parametrize("layer", range(4))
def test_a_lone_wrinkle_has_its_own_angle_all_over(device, layer, share):
    settings = settings_of(bins={**TILTED, "bits": 16})
    angle = np.pi / 4 * (layer + share / 2)
    for turned in (angle, angle + np.pi):
        made = BinnedScene(device, sheet(), furrow(turned), settings)
        drawn = np.abs(made.codes()[layer, -1, 0]) > 0.01 * 32767
        assert drawn.sum() > 200
        np.testing.assert_allclose(made.tilts()[layer][drawn], share * 32767, atol=120)
        others = np.delete(made.tilts(), layer, axis=0)
        np.testing.assert_array_equal(others, 0)


@pytest.mark.slow
def test_tilts_bring_a_lone_wrinkle_to_its_depth_in_redraw(device):
    """Stretched, and a third of a bin off its middle, whose depth it has without tilts."""
    made, errors = {}, {}
    for tilt in (False, True):
        settings = settings_of(bins={**TILTED, "tilt": tilt, "bits": 16}, response={"alpha_w": 0.0})
        made[tilt] = BinnedScene(device, sheet(), furrow(np.pi / 4 * 1.33), settings)
        positions = made[tilt].mesh.positions * np.array([1.28, 0.78, 1.0], np.float32)
        away = made[tilt].blended(positions).reshape(64, 64)
        away = away - made[tilt].redrawn(positions, at=AT, side=64)
        errors[tilt] = np.sqrt(np.square(away).mean())
    assert errors[True] < errors[False] / 3


def test_tilts_want_the_depth_factored():
    with pytest.raises(SettingsError, match=r"bins\.tilt is true: bins\.depth_factored"):
        settings_of(bins={"tilt": True, "depth_factored": False})


def test_reach_is_a_larger_r_max_up_to_what_stretch_is_clamped_to(device):
    reached = settings_of(bins={"r_max": 0.1, "reach": 2.0})
    assert sample_stretches(reached).tolist() == [-0.2, 0.0, 0.2]
    assert settings_of(bins={"r_max": 0.4, "reach": 2.0}).last_sample == 0.5
    plain = BinnedScene(device, sheet(), GRAPH, settings_of(bins={"r_max": 0.2}))
    made = BinnedScene(device, sheet(), GRAPH, reached)
    positions = made.mesh.positions * np.array([1.1, 0.85, 1.0], np.float32)
    np.testing.assert_array_equal(made.blended(positions), plain.blended(positions))
    assert np.abs(made.blended(positions)).max() > 0.3 * DEPTH


def test_reference_tilts_keep_the_points_without_height():
    settings = settings_of(bins=TILTED)
    points = drawing.crop(0, 0, 16, 16, 256)
    found = reference.tilts(
        points, furrow(0.1), 0, settings.response, settings.shape, settings.bins
    )
    np.testing.assert_array_equal(found, 0.0)
