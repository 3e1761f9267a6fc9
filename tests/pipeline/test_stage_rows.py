"""Blocks drawn in parts, where a work-group has no more local memory than OpenCL promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rhytid_kernels
from meshes import deform
from pipeline.binned import BinnedScene
from pipeline.scenes import Scene, random_graph, settings_of, sheet
from rhytid.device.driver import cl
from rhytid.device.launches import launch_shapes
from rhytid.device.programs import BUILD_OPTIONS
from rhytid.device.runtime import Device
from rhytid.errors import DeviceError
from rhytid.pipeline.work import BLOCK

pytestmark = pytest.mark.release

PROMISED = 32 << 10


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


def test_blocks_are_drawn_whole_where_they_fit(device, small):
    whole = Device(replace(device.info, local_memory=PROMISED * 2), device.budget.limit)
    assert (whole.shape.rows, small.shape.rows) == (BLOCK, BLOCK // 2)


def test_a_kernel_that_needs_more_is_refused_with_both_numbers(device):
    tiny = Device(replace(device.info, local_memory=PROMISED // 2), device.budget.limit)
    with pytest.raises(DeviceError, match=r"kernel redraw needs 38\d+ bytes .* has 16384"):
        tiny.programs.kernel("redraw", "redraw", {"BLOCK": BLOCK, "ROWS": BLOCK, "ITEMS": 1})


@pytest.mark.parametrize("program", ["redraw", "bins"])
@pytest.mark.parametrize("lanes", [1, 32])
def test_half_blocks_fit_into_what_is_promised(small, program, lanes):
    defines = {"BLOCK": BLOCK, "ROWS": small.shape.rows, "ITEMS": lanes}
    options = [*BUILD_OPTIONS, *(f"-D{k}={v}" for k, v in defines.items())]
    built = small.programs.build(rhytid_kernels.source(program), options)
    asked = cl.kernel_work_group_info.LOCAL_MEM_SIZE
    for kernel in built.all_kernels():
        assert 0 < kernel.get_work_group_info(asked, small.info.handle) < PROMISED


def test_a_gpu_has_a_work_item_for_each_row(device):
    for memory in (PROMISED, 2 * PROMISED):
        gpu = Device(replace(device.info, kind="gpu", local_memory=memory), 1)
        assert gpu.shape.lanes == gpu.shape.rows
