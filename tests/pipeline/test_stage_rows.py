"""Blocks drawn in parts, where a work-group has no more local memory than OpenCL promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rhytid_kernels
from meshes import deform
from pipeline.binned import BinnedScene, stored_maps
from pipeline.scenes import Scene, ellipses, random_graph, settings_of, sheet
from pipeline.test_stage_bends import bent, shared
from rhytid.device.driver import cl
from rhytid.device.launches import launch_shapes
from rhytid.device.programs import BUILD_OPTIONS
from rhytid.device.runtime import Device
from rhytid.errors import DeviceError
from rhytid.pipeline.cushion import SAMPLES
from rhytid.pipeline.work import BLOCK

pytestmark = pytest.mark.release

PROMISED = 32 << 10


def of_all_kinds(count=500):
    """Lines that bend and have shares, a third of them with a metric of their own."""
    graph = shared(bent(random_graph(41, count, (0.004, 0.02), (0.05, 0.4)), steepest=0.25))
    metric = ellipses(np.random.default_rng(3), graph.edge_half_width)
    metric[: count // 3 * 2] = 0.0
    return replace(graph, edge_metric=metric)


OF_ALL_KINDS = of_all_kinds()
# What the host defines where a work-group draws one map of bins.
ONE_MAP = {"CODE": "char", "CODE_LIMIT": 127, "STRETCHES": 1, "TILTED": 0, "BULGING": 1, "PARTS": 1}


@pytest.fixture
def small(device):
    """The device, as if its work-groups had no more local memory than OpenCL 1.2 promises."""
    return Device(replace(device.info, local_memory=PROMISED), device.budget.limit)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["cpu", "gpu"])
def test_every_shape_gives_the_same_bits(device, kind):
    graph, settings = random_graph(31, 300), settings_of(bins={"count": 2})
    positions = deform(sheet().positions, 3, 0.15)

    def drawn(shape):
        own = Device(device.info, device.budget.limit)
        own.shape = shape
        codes = BinnedScene(own, sheet(), graph, settings).codes()
        return Scene(own, sheet(), graph, settings).redrawn(positions), codes

    redrawn, codes = drawn(launch_shapes("cpu", device.info.local_memory, 1024)[0])
    assert np.abs(redrawn).max() > 0
    for shape in launch_shapes(kind, device.info.local_memory, 1024):
        found = drawn(shape)
        np.testing.assert_array_equal(found[0], redrawn, str(shape))
        np.testing.assert_array_equal(found[1], codes, str(shape))


# Seven maps at once by three: 3, 3 and 1; by five: 2 with owners and 5; by more: all with owners.
# All other tests draw all at once. Each number of maps is a program of its own, for a second.
@pytest.mark.parametrize(
    ("merge", "bulge", "numbers"),
    [
        ("soft", 1.0, (5,)),
        pytest.param("soft", 1.0, (3, 99), marks=pytest.mark.slow),
        pytest.param("mellow", 2.5, (3, 5, 99), marks=pytest.mark.slow),
    ],
)
def test_maps_drawn_at_once_are_those_drawn_alone(device, monkeypatch, merge, bulge, numbers):
    bulges = {"wrinkle_bulge": bulge, "pore_bulge": bulge, "least_half_width": 0.7}
    settings = settings_of(
        shape={"cushion": 0.7, "curvature": 1.0, "taper": 1.0, **bulges},
        response={"ends": 1.0, "soft_limits": True},
        bins={"merge": merge, "depth_factored": True, "tilt": True, "pore_samples": 5},
    )

    def maps(most):
        monkeypatch.setattr(Device, "maps_at_once", lambda *_: most)
        tile = BinnedScene(device, sheet(), OF_ALL_KINDS, settings).tile
        cushion = [tile.cushion.read(device, index, 8) for index in range(SAMPLES + 1)]
        owners = tile.cushion.read_owners(device)
        return [*stored_maps(device, tile, settings.bins), *cushion, owners]

    alone = maps(1)
    assert min(np.count_nonzero(codes) for codes in alone) > 50
    for most in numbers:
        for found, wanted in zip(maps(most), alone, strict=True):
            np.testing.assert_array_equal(found, wanted)


def test_maps_in_two_parts_drawn_at_once_are_those_drawn_alone(device, monkeypatch):
    """Bulges and furrows of `mellow`, by three, of straight lines alike: others are slow."""
    bulges = {"wrinkle_bulge": 2.5, "pore_bulge": 2.5}
    settings = settings_of(shape=bulges, bins={"merge": "mellow"})

    def maps(most):
        monkeypatch.setattr(Device, "maps_at_once", lambda *_: most)
        tile = BinnedScene(device, sheet(), random_graph(41, 300), settings).tile
        return stored_maps(device, tile, settings.bins)

    alone = maps(1)
    assert min(np.count_nonzero(codes) for codes in alone) > 50
    for found, wanted in zip(maps(3), alone, strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_blocks_are_drawn_whole_where_they_fit(device, small):
    whole = Device(replace(device.info, local_memory=PROMISED * 2), device.budget.limit)
    assert (whole.shape.rows, small.shape.rows) == (BLOCK, BLOCK // 2)


def test_a_kernel_that_needs_more_is_refused_with_both_numbers(device):
    tiny = Device(replace(device.info, local_memory=PROMISED // 2), device.budget.limit)
    with pytest.raises(DeviceError, match=r"kernel redraw needs 38\d+ bytes .* has 16384"):
        tiny.programs.kernel("redraw", "redraw", {"BLOCK": BLOCK, "ROWS": BLOCK, "ITEMS": 1})


@pytest.mark.parametrize("program", ["redraw", "bins", "pore_layer"])
@pytest.mark.parametrize("lanes", [1, 32])
def test_half_blocks_fit_into_what_is_promised(small, program, lanes):
    defines = {"BLOCK": BLOCK, "ROWS": small.shape.rows, "ITEMS": lanes, **ONE_MAP}
    options = [*BUILD_OPTIONS, *(f"-D{k}={v}" for k, v in defines.items())]
    built = small.programs.build(rhytid_kernels.source(program), options)
    asked = cl.kernel_work_group_info.LOCAL_MEM_SIZE
    for kernel in built.all_kernels():
        assert 0 < kernel.get_work_group_info(asked, small.info.handle) < PROMISED


def test_a_gpu_has_a_work_item_for_each_row(device):
    for memory in (PROMISED, 2 * PROMISED):
        gpu = Device(replace(device.info, kind="gpu", local_memory=memory), 1)
        assert gpu.shape.lanes == gpu.shape.rows
