"""The wrinkles that `rhytid bench` times, and whether there is memory for them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection
from typing import Any

from rhytid.baking.input_files import graph_file
from rhytid.cli.skin_options import density
from rhytid.console import share_bar
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.engine.given_graphs import check_graph
from rhytid.synthesis.fields.capacity_check import wrinkles_in_all
from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.surface import Surface
from rhytid_lab.bench.memory import Need
from rhytid_lab.bench.service import METHODS

# Where the bins are the most that `--scaling` times.
_MOST_BINS = 16


def skin(
    device: Device, mesh: Mesh, arguments: argparse.Namespace
) -> tuple[WrinkleGraph, AssetSettings]:
    """The wrinkles of the arguments, given or synthesised, and the settings to draw them with.

    Prints the memory that the bench needs, and raises DeviceMemoryError before any work where there
    is less.
    """
    settings = _settings(arguments, graph=density(arguments))
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


def scaled_settings(arguments: argparse.Namespace) -> AssetSettings:
    """Settings of the largest frame of `--scaling`."""
    return _settings(arguments, bins={"count": _MOST_BINS})


def print_need(
    device: Device, mesh: Mesh, settings: AssetSettings, cases: Collection[str], wrinkles: float
) -> None:
    """Say on stderr what the bench needs; raises DeviceMemoryError where there is less."""
    need = Need.of(settings, cases, wrinkles, len(mesh.faces))
    need.check(device)
    size = f"{settings.resolution} x {settings.resolution} texels, {wrinkles:,.0f} wrinkles"
    print(f"rhytid bench: {size}: {need.text()}", file=sys.stderr, flush=True)


def _cases(arguments: argparse.Namespace) -> Collection[str]:
    return METHODS if arguments.service else tuple(arguments.methods)


def _settings(arguments: argparse.Namespace, **more: Any) -> AssetSettings:
    sizes = {"resolution": arguments.size, "preset": arguments.preset}
    return AssetSettings.parse({**sizes, **more})
