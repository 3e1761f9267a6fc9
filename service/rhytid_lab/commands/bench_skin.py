"""The wrinkles that `rhytid bench` times, and the memory that this needs: many GiB at 16384²."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from rhytid.baking.input_files import graph_file
from rhytid.cli.skin_options import density
from rhytid.device.memory import machine_memory
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import rough_count
from rhytid.engine.assets.graphs import check_graph
from rhytid.errors import DeviceMemoryError
from rhytid.pipeline.bins import map_count
from rhytid.pipeline.cushion import bytes_a_sample
from rhytid.support.console import share_bar
from rhytid.synthesis.capacity import wrinkles_in_all
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.surface import Surface
from rhytid_lab.bench.service import METHODS

# Where the bins are the most that `--scaling` times.
_MOST_BINS = 16
MIB, GIB = 1 << 20, 1 << 30
# Bytes on the device, measured on the built-in face at 1024² and 2048² with 5,000 to 300,000
# wrinkles. A texel: two maps that are copied; what a case draws into; the triangles beside the
# precomputed maps; the neutral tiles of `convolved` with their rims, at the widest blur.
_COPIES, _DRAWN, _PLACED, _NEUTRAL = 8.0, 4.5, 1.6, 11.5
# Of cushions, at half the resolution where it is finest: a map, and a code of grain.
_BROAD = 2.0
# A wrinkle with its pores and its log stretch, a triangle.
_WRINKLE, _TRIANGLE = 78, 240
# Bytes on the host: a map that is read in tiles and put together; a wrinkle while it is grown; what
# the process and its libraries take.
_READ, _GROWN, _PROCESS = 8.0, 210, 400_000_000


def skin(
    device: Device, mesh: Mesh, arguments: argparse.Namespace
) -> tuple[WrinkleGraph, AssetSettings]:
    """Return the wrinkles of the arguments, given or synthesised, and the settings to draw them
    with.

    Prints the memory that the bench needs, and raises DeviceMemoryError before any work where there
    is less.
    """
    settings = frame_settings(arguments)
    if arguments.graph is not None:
        graph = graph_file(arguments.graph)
        check_graph(graph, mesh, force=arguments.force)
        settings = settings.for_graph(graph.origin)
        print_need(device, mesh, settings, _cases(arguments), graph.wrinkles)
        return graph, settings
    settings = settings.for_synthesis()
    wrinkles = wrinkles_in_all(Surface.of(mesh), settings.graph, Fields())
    print_need(device, mesh, settings, _cases(arguments), wrinkles)
    with share_bar("synthesis") as show:
        made = synthesize(mesh, settings.graph, device, show)
    return made.graph, settings.resolved(made.spacing)


def frame_settings(arguments: argparse.Namespace) -> AssetSettings:
    """Settings of the frame that the arguments ask for."""
    return _settings(arguments, graph=density(arguments))


def scaled_settings(arguments: argparse.Namespace) -> AssetSettings:
    """Settings of the largest frame of `--scaling`."""
    return _settings(arguments, bins={"count": _MOST_BINS})


def print_need(
    device: Device, mesh: Mesh, settings: AssetSettings, cases: Collection[str], wrinkles: float
) -> None:
    """Say on stderr what the bench needs; raises DeviceMemoryError where there is less."""
    need = Need.of(settings, cases, wrinkles, len(mesh.faces))
    need.check(device)
    # Else they follow from the spacing, roughly.
    known = isinstance(wrinkles, int) or settings.graph.wrinkles is not None
    count = f"{wrinkles:,.0f}" if known else f"about {rough_count(wrinkles)}"
    size = f"{settings.resolution} x {settings.resolution} texels, {count} wrinkles"
    print(f"rhytid bench: {size}: {need.text()}", file=sys.stderr, flush=True)


def _cases(arguments: argparse.Namespace) -> Collection[str]:
    return METHODS if arguments.service else tuple(arguments.methods)


def _settings(arguments: argparse.Namespace, **more: Any) -> AssetSettings:
    sizes = {"resolution": arguments.size, "preset": arguments.preset}
    return AssetSettings.parse({**sizes, **more})


@dataclass(frozen=True)
class Need:
    """The bytes that a bench needs on the device and on the host, roughly."""

    device: int
    host: int

    @classmethod
    def of(
        cls, settings: AssetSettings, cases: Collection[str], wrinkles: float, triangles: int
    ) -> Need:
        """Return the need of these cases of a frame together: maps of one case that another uses
        are kept."""
        a_texel = _COPIES + _DRAWN
        a_texel += _BROAD if settings.shape.cushion > 0.0 else 0.0
        if {"binned", "precompute"} & set(cases):
            bins, codes = settings.bins, settings.bins.bits / 8
            a_texel += map_count(bins) * codes + _PLACED
            if settings.shape.cushion > 0.0:
                a_texel += 0.25 * bytes_a_sample(settings)
        if "convolved" in cases:
            a_texel += _NEUTRAL
        texels = settings.resolution**2
        device = a_texel * texels + _WRINKLE * wrinkles + _TRIANGLE * triangles
        return cls(int(device), int(_READ * texels + _GROWN * wrinkles + _PROCESS))

    def check(self, device: Device) -> None:
        """Raise DeviceMemoryError where the budget, the device or the machine has less."""
        limit, cpu = device.budget.limit, device.info.kind == "cpu"
        if self.device > limit:
            raise DeviceMemoryError(
                f"{self.text()}: the budget is {_gib(limit)} of the {_gib(device.info.memory)} of "
                f"{device.info.name}; raise RHYTID_DEVICE_MEMORY_MB to {self.device // 2**20 + 1} "
                "where there is that much, or take fewer --methods or a smaller --size"
            )
        has, wanted = machine_memory(), self.host + (self.device if cpu else 0)
        if wanted > has:
            raise DeviceMemoryError(
                f"{self.text()}: the machine has {_gib(has)}; take fewer --methods or a smaller "
                "--size"
            )

    def text(self) -> str:
        """The need in words."""
        return f"needs about {_gib(self.device)} of device memory and {_gib(self.host)} beside it"


def _gib(count: int) -> str:
    return f"{count / GIB:.1f} GiB" if count >= GIB / 10 else f"{count / MIB:.0f} MiB"
