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
from rhytid.domain.warnings import SCAN_FILL, InputWarning
from rhytid.errors import InputError
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.progress import Progress, part, silent
from rhytid.synthesis.workspace import Caller, Workspace, directly
from rhytid.tracing.detail import with_detail
from rhytid.tracing.fit import drawn_neutral
from rhytid.tracing.measure import depth_of, fine_part
from rhytid.tracing.mixed import Growth, ScanShares, denied_of, mixed
from rhytid.tracing.trace import Relief, Trace, TraceSettings, charted, trace, traced_settings

# How much of the work is done when skin is grown that fills in.
_GROWN = 0.5


def traced_scan(
    device: Device,
    mesh: Mesh,
    scan: ScanRelief,
    settings: AssetSettings,
    progress: Progress = silent,
    call: Caller = directly,
    growth: Growth | None = None,
) -> Trace:
    """Trace a scan. The depth of a line of weight 1, which the graph then says, is measured where
    settings do not say it.

    UDIMs of the mesh without a map stay as they are at rest, unless grown skin fills in.

    settings: not resolved.  progress, call: as of `trace`.  growth: what skin grows by that fills
    in. Raises InputError where there is nothing to trace, and what `trace` and `synthesize` do.
    """
    if scan.filled:
        return _filled(device, mesh, scan, settings, progress, call, growth or Growth())
    spacing = settings.graph.spacing or usual_spacing(settings.length_unit)
    progress(0.0, "measuring")
    charts = {
        udim: charted(device, mesh, udim, settings) & ~denied_of(scan, udim, settings.resolution)
        for udim in scan.maps
    }
    if not any(inside.any() for inside in charts.values()):
        raise InputError("there is nothing to trace: the scan is masked out throughout")
    depth = settings.depth or _depth(Workspace(device, call), scan, charts)
    if depth == 0.0:
        raise InputError("there are no lines in the scan: its charts have no fine relief")
    resolved = replace(settings, depth=depth).resolved(spacing)
    how = TraceSettings(spacing=spacing, noise=scan.noise)
    found = trace(device, mesh, scan.maps, resolved, how, progress, call, charts)
    beyond = _beyond(device, mesh, scan, found, resolved)
    found = replace(found, residual=found.residual | beyond)
    if scan.detail > 0.0:
        found = with_detail(device, mesh, scan, found, resolved, settings.shape.grain_size)
    return found


def fill_warnings(scan: ScanRelief, found: Trace) -> tuple[InputWarning, ...]:
    """scan-fill, where skin was to fill in and found no place."""
    if found.grown or not scan.filled:
        return ()
    detail = (
        "skin is to fill in where the scan is flat, masked out or missing, and it is so nowhere: "
        "none has grown"
    )
    udims = ", ".join(map(str, sorted(scan.maps)))
    return (InputWarning(SCAN_FILL, detail, f"UDIM {udims}"),)


def _filled(
    device: Device,
    mesh: Mesh,
    scan: ScanRelief,
    settings: AssetSettings,
    progress: Progress,
    call: Caller,
    growth: Growth,
) -> Trace:
    """Trace a scan, and let skin grow where there is none."""
    progress(0.0, "measuring")
    shares = ScanShares.of(device, mesh, scan, settings.resolution)
    if shares.all_scan:
        return traced_scan(device, mesh, replace(scan, border=0.0), settings, progress, call)
    maps, charts = _counting(device, mesh, scan, settings, shares)
    settings = settings.for_synthesis()
    grown = synthesize(
        mesh, settings.graph, device, part(progress, 0.0, _GROWN), call=call,
        controls=growth.controls, folds=growth.folds, unit=settings.length_unit,
    )  # fmt: skip
    progress(_GROWN, "measuring")
    scan = replace(scan, maps=maps)
    depth = settings.depth or max(
        grown.lengths.depth, _depth(Workspace(device, call), scan, charts)
    )
    resolved = replace(settings, depth=depth).resolved(grown.spacing)
    how = TraceSettings(spacing=grown.spacing, noise=scan.noise)
    found = trace(device, mesh, maps, resolved, how, part(progress, _GROWN, 1.0), call, charts)
    drawn = grown.graph, settings.depth or grown.lengths.depth
    return mixed(device, mesh, scan, found, drawn, shares, resolved)


def _counting(
    device: Device, mesh: Mesh, scan: ScanRelief, settings: AssetSettings, shares: ScanShares
) -> tuple[dict[int, Relief], dict[int, NDArray[np.bool_]]]:
    """The maps that count somewhere, and in which texels; refuses a scan that counts nowhere, or
    nowhere in full, so that nothing of the skin would be the scan at rest."""
    resolution, charts, full = settings.resolution, {}, False
    for udim in scan.maps:
        share, chart = shares.texels(udim, resolution), charted(device, mesh, udim, settings)
        charts[udim] = chart & (share > 0)
        full |= bool((share[chart] == 1.0).any())
    maps = {udim: map for udim, map in scan.maps.items() if charts[udim].any()}
    if not maps:
        raise InputError("there is nothing to trace: the scan is flat or masked out throughout")
    if not full:
        raise InputError(
            "there is no place where the scan counts in full: the border of skin that fills in is "
            f"{scan.border:g} mesh units wide, and what is flat, masked out or missing is nearer "
            "than that everywhere; make it narrower"
        )
    return maps, charts


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
