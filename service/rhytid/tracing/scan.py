"""Traces the scan of an asset with the settings of that asset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import usual_spacing
from rhytid.domain.mesh import Mesh
from rhytid.domain.residual import ScanRelief
from rhytid.domain.tiles import mesh_udims
from rhytid.errors import InputError
from rhytid.synthesis.progress import Progress, silent
from rhytid.synthesis.workspace import Caller, Workspace, directly
from rhytid.tracing.detail import with_detail
from rhytid.tracing.fit import drawn_neutral
from rhytid.tracing.measure import depth_of, fine_part
from rhytid.tracing.trace import Trace, TraceSettings, charted, trace, traced_settings


def traced_scan(
    device: Device,
    mesh: Mesh,
    scan: ScanRelief,
    settings: AssetSettings,
    progress: Progress = silent,
    call: Caller = directly,
) -> Trace:
    """Trace a scan. The depth of a line of weight 1, which the graph then says, is measured where
    settings do not say it.

    UDIMs of the mesh without a map stay as they are at rest.

    settings: not resolved.  progress, call: as of `trace`. Raises InputError where there is
    nothing to trace, and what `trace` does.
    """
    spacing = settings.graph.spacing or usual_spacing(settings.length_unit)
    progress(0.0, "measuring")
    charts = {udim: charted(device, mesh, udim, settings) for udim in scan.maps}
    depth = settings.depth or _depth(Workspace(device, call), scan, charts)
    if depth == 0.0:
        raise InputError("there are no lines in the scan: its charts have no fine relief")
    resolved = replace(settings, depth=depth).resolved(spacing)
    how = TraceSettings(spacing=spacing, noise=scan.noise)
    found = trace(device, mesh, scan.maps, resolved, how, progress, call, charts)
    if scan.detail > 0.0:
        found = with_detail(device, mesh, scan, found, resolved, settings.shape.grain_size)
    return replace(found, residual=found.residual | _beyond(device, mesh, scan, found, resolved))


def _depth(work: Workspace, scan: ScanRelief, charts: dict[int, NDArray[np.bool_]]) -> float:
    """The depth of a line of weight 1, mesh units; 0 where there is no relief."""
    return max(
        depth_of(fine_part(work, relief, charts[udim]), charts[udim])
        for udim, relief in scan.maps.items()
    )


def _beyond(
    device: Device, mesh: Mesh, scan: ScanRelief, found: Trace, settings: AssetSettings
) -> dict[int, NDArray[np.float32]]:
    """The residual of UDIMs without a map, into which lines reach over a border: it takes away
    what they draw there at rest."""
    drawn = traced_settings(settings)
    others = [udim for udim in mesh_udims(mesh) if udim not in scan.maps]
    maps = {udim: drawn_neutral(device, found.graph, drawn, udim) for udim in others}
    return {udim: -map for udim, map in maps.items() if map.any()}
