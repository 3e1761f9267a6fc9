"""Every kernel compiles by itself, without a warning."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import rhytid_kernels
from rhytid.device import driver
from rhytid.device.programs import BUILD_OPTIONS
from rhytid.errors import KernelBuildError

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from rhytid.device.runtime import Device

STRICT = "-Werror"
# What the host may define, at both ends of its range; a program takes what it needs of it.
SMALL = (
    "BLOCK=64",
    "ROWS=32",
    "ITEMS=1",
    "SCALE_LIMIT=4.0f",
    "CODE=char",
    "STRETCHES=3",
    "TILTED=1",
    "BULGING=0",
    "AHEAD=1",
    "CODE_BITS=8",
    "CODE_LIMIT=127",
    "MAPS=6",
    "WAYS=12",
    "CROSSINGS=1",
    "STRIP=8",
    "PATCH_CELLS=64",
    "PATCH_LEAST=0.25f",
    "MOST_UNDULATION=2.6f",
)
SMALL_LAYERS = (
    "LAYERS=2",
    "SAMPLES=3",
    "PORE_SAMPLES=3",
    "ORIENTED=0",
    "PARTS=1",
    "MERGE=MIN",
    "TILT=0",
)
LARGE = (
    "BLOCK=64",
    "ROWS=MOST",
    "ITEMS=64",
    "SCALE_LIMIT=4.0f",
    "CODE=short",
    "STRETCHES=1",
    "TILTED=1",
    "BULGING=1",
    "CODE_BITS=16",
    "CODE_LIMIT=32767",
    "MAPS=250",
    "WAYS=12",
    "CROSSINGS=64",
    "STRIP=8",
    "PATCH_CELLS=64",
    "PATCH_LEAST=0.25f",
    "MOST_UNDULATION=2.6f",
)
LARGE_LAYERS = ("LAYERS=17", "SAMPLES=7", "PORE_SAMPLES=5", "ORIENTED=16")
TILTED = ("TILT=1", "TILT_NODE=0.6f")
MELLOW = (*LARGE_LAYERS, *TILTED, "PARTS=2", "MERGE=MELLOW", "BENT=1", "SOFT_LIMITS=1", "SHARED=1")
SOFT = (*LARGE_LAYERS, *TILTED, "PARTS=1", "MERGE=SOFT", "WAVY=1", "BENT=1", "SKEWED=1")
WAVY = (*SMALL_LAYERS, "WAVY=1", "SOFT_LIMITS=1", "SKEWED=1")
SKEWED = (*SMALL_LAYERS, "SKEWED=1", "BENT=1", "SHARED=1")
# Of a layer with an apron around its blocks.
COARSE = ("APRON=2", "COARSE_BLOCK=60", "LEAST_HALF_WIDTH=1.25f", "WIDENED=1.5f")
RANGES = {
    "small": (*SMALL, *SMALL_LAYERS, *COARSE),
    "wavy": (*SMALL, *WAVY, *COARSE, "COARSER=2", "RAISED=1"),
    "skewed": (*SMALL, *SKEWED, *COARSE, "COARSER=16", "RAISED=1"),
    "mellow": (*LARGE, *MELLOW, *COARSE, "COARSER=4", "RAISED=1"),
    "soft": (*LARGE, *SOFT, *COARSE, "COARSER=8", "RAISED=1"),
}


# .ci/run has the compiler of the runtime from pip do it.
@pytest.mark.release
@pytest.mark.parametrize("defines", RANGES.values(), ids=RANGES)
@pytest.mark.parametrize("name", rhytid_kernels.names())
def test_a_program_compiles_alone(
    device: Device, name: str, defines: tuple[str, ...], driver_builds: list[list[str]]
) -> None:
    fitting = (d.replace("ROWS=MOST", f"ROWS={device.shape.rows}") for d in defines)
    options = [*BUILD_OPTIONS, STRICT, *(f"-D{define}" for define in fitting)]

    device.programs.build(rhytid_kernels.source(name), options)

    # At once, on PoCL too: builtins.clh has all that it uses.
    assert [driver.HEADER_READ in given for given in driver_builds] == [
        device.info.platform == driver.POCL
    ]


def test_a_warning_stops_the_build(device: Device) -> None:
    silent = "int f(int x) { } __kernel void k(__global int *x) { x[0] = f(x[0]); }"

    with pytest.raises(KernelBuildError):
        device.programs.build(silent, [*BUILD_OPTIONS, STRICT])


def test_there_are_programs() -> None:
    assert {"stretch", "tension", "uv_stretch", "redraw", "bins", "blend"} <= set(
        rhytid_kernels.names()
    )
