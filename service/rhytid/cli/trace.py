"""`rhytid trace`: a scan's relief as a wrinkle graph and what the graph does not draw."""

from __future__ import annotations

import argparse
import json
import shlex
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.graph_output import open_device
from rhytid.cli.options import (
    add_json,
    add_mesh,
    add_prim,
    add_strict,
    add_unit,
    length_unit,
    map_file,
    prim_clip,
    with_warnings,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.scan_options import (
    SCAN_FILES,
    add_scan_settings,
    add_traced_settings,
    checked_scan,
)
from rhytid.cli.service_options import add_device
from rhytid.cli.skin_options import add_settings, given_settings
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import millimetres, unit_after_number, usual_spacing
from rhytid.domain.settings_changes import READ_OF_GIVEN
from rhytid.support.console import make_folder, report, share_bar, table, working

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.device.runtime import Device
    from rhytid.domain.mesh import Mesh
    from rhytid.domain.residual import ScanRelief
    from rhytid.domain.warnings import InputWarning
    from rhytid.tracing.measure import Left
    from rhytid.tracing.trace import Trace

GRAPH, SETTINGS, PICTURE = "graph.safetensors", "settings.json", "trace.png"
SUMMARY = SUMMARIES["trace"]
DETAILS = f"""
Writes into a folder the graph, {GRAPH}; residual.<UDIM>.exr, what the graph does not draw, in mesh
units; {SETTINGS}, with which `bake` draws the graph; and {PICTURE}, a picture of scan, lines and
rest. What `bake --graph {GRAPH} --residual residual.<UDIM>.exr --settings {SETTINGS}`
draws at rest is the scan. Lines and pores that are not found do not move. `bake --scan` does all
of it at once."""
# Texels of a side that no more is taken of a scan than, unless it is asked for.
_USUAL = AssetSettings().resolution


def add_command(commands: Commands) -> None:
    """Add `trace` to the parser."""
    example = "rhytid trace head.obj disp.1001.tif --scale 2 --scan-unit mm --out traced"
    parser = new_command(commands, "trace", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    add = parser.add_argument
    add_mesh(parser, "MESH")
    add("maps", nargs="+", type=map_file, metavar="MAP", help=SCAN_FILES)
    add("--out", type=Path, required=True, metavar="FOLDER", help="folder of the files")
    add_scan_settings(parser)
    add_traced_settings(parser)
    size = (
        "texels per side that are traced, a power of two (default: as many as the map has, at most "
        f"{_USUAL})"
    )
    add("--resolution", type=int, metavar="R", help=size)
    add_settings(parser, ", as for bake: with its depth, shape and preset lines are drawn")
    add_unit(parser, "MESH", "that of a USD file which names one, else cm")
    add_prim(parser)
    add_device(parser)
    add_strict(parser)
    add_json(parser)
    parser.set_defaults(run=run)


@with_warnings
def run(arguments: argparse.Namespace, warnings: RunWarnings) -> None:
    """Trace the scan, write what was found, and report its figures."""
    scan = _read(arguments, warnings)
    make_folder(arguments.out)
    device = open_device(arguments)
    start = time.monotonic()
    found = _traced(device, scan)
    warnings.add(found.warnings)
    warnings.refuse()
    out: Path = arguments.out
    _write(out, device, scan, found)
    figures = {
        "folder": str(out),
        "seconds": round(time.monotonic() - start, 3),
        **found.figures(),
        **warnings.all_figures(),
    }
    report(figures, _text(arguments, figures), arguments.json)


@dataclass(frozen=True, eq=False)
class _Scan:
    """What is traced.  settings: not resolved, with unit and resolution.  given: as JSON, those
    that `bake` needs.  relief: of the scan, resampled."""

    mesh: Mesh
    settings: AssetSettings
    given: dict[str, Any]
    relief: ScanRelief


def _read(arguments: argparse.Namespace, warnings: RunWarnings) -> _Scan:
    """Read and check everything. Raises InputError, MeshError and SettingsError; opens no
    device."""
    from rhytid.baking.input_files import mesh_file

    given = given_settings(arguments)
    arguments.unit = arguments.unit or given.get("unit")
    asked = arguments.resolution or given.get("resolution")
    AssetSettings.parse({**given, "resolution": asked or _USUAL})
    read = mesh_file(arguments.mesh, prim_clip(arguments.prim))
    mesh, unit = read.mesh, length_unit(arguments, read)
    warnings.file(read)
    check = checked_scan(arguments, arguments.maps, mesh, unit, warnings)
    given |= {"unit": unit, "resolution": asked or check.resolution()}
    settings = AssetSettings.parse(given)
    if settings.graph.spacing is None:
        usual_spacing(unit)  # refuses a unit of no known length before a device opens
    warnings.inputs(mesh, arguments.mesh.name, unit, settings.resolution)
    warnings.refuse()
    with working("resampling the scan"):
        relief = check.relief(settings.resolution)
    return _Scan(mesh, settings, given, relief)


@dataclass(frozen=True, eq=False)
class _Found:
    """What was traced.  settings: of the scan.  left: of each UDIM.  warnings: of all of it."""

    trace: Trace
    settings: AssetSettings
    left: dict[int, Left]
    warnings: tuple[InputWarning, ...]

    def figures(self) -> dict[str, Any]:
        """For JSON; lengths in mesh units."""
        origin = self.trace.graph.origin
        assert origin is not None  # a traced graph says what it was made for
        pores, wrinkles = self.trace.graph.counts()
        return {
            "wrinkles": wrinkles,
            "pores": pores,
            "depth": origin.depth,
            "unit": self.settings.length_unit,
            "resolution": self.settings.resolution,
            "udims": [
                {"udim": udim, **asdict(left), "noise": self.trace.noise[udim]}
                for udim, left in self.left.items()
            ],
        }


def _traced(device: Device, scan: _Scan) -> _Found:
    """Trace the scan as the build of an asset does, and measure what was found."""
    from rhytid.synthesis.workspace import Workspace
    from rhytid.tracing.measure import Left
    from rhytid.tracing.scan import fill_warnings, traced_scan

    with share_bar("tracing") as show:
        found = traced_scan(device, scan.mesh, scan.relief, scan.settings, show)
    with working("measuring the residual"):
        work = Workspace(device)
        left = {
            udim: Left.of(work, scan.relief.maps[udim], found.residual[udim], inside)
            for udim, inside in sorted(found.charts.items())
        }
    of_lines = (warning for udim, one in left.items() for warning in one.warnings(udim))
    return _Found(found, scan.settings, left, (*fill_warnings(scan.relief, found), *of_lines))


def _write(out: Path, device: Device, scan: _Scan, found: _Found) -> None:
    """Write all files, which appear together when the last one is complete."""
    from rhytid.formats.graphs import graph_pieces
    from rhytid.support.atomic_files import install, working_folder, write_file, write_pieces

    with working_folder(out) as place, working("writing"):
        write_pieces(place / GRAPH, graph_pieces(found.trace.graph))
        for udim, residual in sorted(found.trace.residual.items()):
            pieces = _residual(device, scan, udim, residual)
            write_pieces(place / f"residual.{udim}.exr", pieces)
        settings = _for_bake(scan, grown=found.trace.grown)
        write_file(place / SETTINGS, f"{json.dumps(settings, indent=2)}\n".encode())
        _draw(place / PICTURE, scan, found)
        for file in sorted(place.iterdir()):
            install(file, out / file.name)


def _residual(device: Device, scan: _Scan, udim: int, residual: NDArray[np.float32]) -> list[bytes]:
    """The pieces of the file of a UDIM, padded around charts as maps of `bake` are."""
    from rhytid.exports.textures.frame_map import Padding
    from rhytid.formats.exr_encoder import exr_parts
    from rhytid.support.build_identity import file_attributes
    from rhytid.tracing.trace import shown

    settings, mesh = scan.settings, scan.mesh
    reach = settings.padding
    triangles = shown(device, mesh, udim, settings.resolution, reach)
    padded = Padding.of(mesh, udim, triangles, reach).padded(residual)
    facts: dict[str, Any] = {"unit": settings.length_unit, "udim": udim, "kind": "residual"}
    facts |= {"scale": 1.0, "midlevel": 0.0}
    facts |= {"minimum": float(padded.min()), "maximum": float(padded.max())}
    return exr_parts(padded, {**facts, **file_attributes()})


def _for_bake(scan: _Scan, *, grown: bool) -> dict[str, Any]:
    """The settings with which `bake` draws the graph: grain and undulation are in the residual,
    unless grown skin fills in, and lines bend and change along their way, whatever the preset says.
    Settings by which skin grows are left out."""
    from rhytid.tracing.trace import traced_settings

    shape = scan.settings.shape
    drawn = asdict(traced_settings(scan.settings, scan.relief.detail > 0.0, grown).shape)
    other = {name: value for name, value in drawn.items() if value != getattr(shape, name)}
    no_more = {name: drawn[name] for name in ("grain", "undulation")}
    given = {**scan.given, "shape": {**scan.given.get("shape", {}), **no_more, **other}}
    if "graph" in given:
        given["graph"] = {n: v for n, v in given["graph"].items() if n in READ_OF_GIVEN}
    return given


def _draw(file: Path, scan: _Scan, found: _Found) -> None:
    """Draw the picture of the UDIM with the largest charts."""
    from rhytid.domain.uv_layout import mean_uv_length
    from rhytid.pictures.traced import traced_picture

    charts = found.trace.charts
    udim = max(charts, key=lambda u: (int(charts[u].sum()), -u))
    relief, residual = scan.relief.maps[udim], found.trace.residual[udim]
    caption = f"UDIM {udim}. Above all of it, below a part where most lines are."
    texel = mean_uv_length(scan.mesh, udim) / scan.settings.resolution
    picture = traced_picture(relief, residual, charts[udim], texel, caption)
    picture.save(file, format="png")


def _text(arguments: argparse.Namespace, figures: dict[str, Any]) -> str:
    """What was found, for people."""
    known = millimetres(figures["unit"])
    factor, unit = (1.0, unit_after_number(figures["unit"])) if known is None else (known, "mm")
    counts = f"{arguments.out}: {figures['wrinkles']} wrinkles, {figures['pores']} pores"
    header = ("UDIM", f"relief, {unit}", "left, %", "fine, %", f"noise, {unit}")
    rows = [
        (u["udim"], f"{factor * u['relief']:.3g}",
         *(f"{100 * u[n]:.0f}" for n in ("left", "fine_left")), f"{factor * u['noise']:.2g}")
        for u in figures["udims"]
    ]  # fmt: skip
    return "\n".join(
        [
            f"{counts}; a line of weight 1 is {factor * figures['depth']:.3g} {unit} deep",
            table(header, rows),
            "left: root mean square of the residual over that of the relief, about their means; "
            "fine: of what is narrower than 33 texels",
            f"the lines move with: {_bake_command(arguments)}",
        ]
    )


def _bake_command(arguments: argparse.Namespace) -> str:
    """What to type to bake what was traced. Quoted for a shell, which would read `<UDIM>` as a file
    for its input; what is left to say is SHOT."""
    out: Path = arguments.out
    words = ["rhytid", "bake", arguments.mesh, "--frames", "SHOT", "--graph", out / GRAPH]
    words += ["--residual", out / "residual.<UDIM>.exr", "--settings", out / SETTINGS]
    return shlex.join(str(word) for word in (*words, "--out", "maps"))
