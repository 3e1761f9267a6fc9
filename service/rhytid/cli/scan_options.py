"""Options of commands that read scanned displacement."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.options import Arguments, add_several, map_file, unit_name
from rhytid.domain.scan import AUTO, FLIPS, ScanSettings
from rhytid.errors import InputError

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.domain.mesh import Mesh
    from rhytid.meshes.scan_check import ScanCheck

SCAN_FILES = (
    "displacement along the normal, EXR, PNG, TIFF or JPEG: one file for each UDIM, as "
    "face.1001.exr, or face.<UDIM>.exr for all"
)
# Settings of a scan in messages, and the options that set them.
_SETTING = re.compile(r"(?<!\S)scan\.(scale|midlevel|unit|flip|partial|detail|fill)\b")
_OPTIONS = {
    "scale": "--scale",
    "midlevel": "--midlevel",
    "unit": "--scan-unit",
    "flip": "--flip",
    "partial": "--partial",
    "detail": "--detail",
    "fill": "--fill",
}


def midlevel(text: str) -> float | str:
    """A number, or `auto`."""
    try:
        return AUTO if text == AUTO else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: a number, or {AUTO}") from None


def scale(text: str) -> float:
    """A number without a unit."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r}: a number, or three with spaces between them; --scan-unit says of which "
            "unit, and files of maps stand before this option"
        ) from None


def add_scan_settings(parser: Arguments) -> None:
    """Add `--scale`, `--midlevel`, `--scan-unit`, `--flip` and `--partial`."""
    add = parser.add_argument
    length = (
        "length from black to white, or of 1 in files of floats; three for a map of three bands; "
        "below 0 turns the relief inside out (default: 1 for floats; others need one)"
    )
    add("--scale", type=scale, nargs="+", metavar="S", help=length)
    level = (
        "value of a surface without relief: 0, 0.5, another number, or auto, what is outside of "
        "the charts (default: 0.5, in files of floats 0)"
    )
    add("--midlevel", type=midlevel, metavar="M", help=level)
    unit = "length unit of --scale, as mm (default: that of the mesh)"
    add("--scan-unit", type=unit_name, metavar="U", help=unit)
    flip = "turn the map over: v top to bottom, u left to right, uv both"
    add("--flip", choices=FLIPS, help=flip)
    partial = "let UDIMs of the mesh have no map: the surface stays there"
    add("--partial", action="store_true", help=partial)


def add_traced_settings(parser: Arguments) -> None:
    """Add `--detail`, `--fill` and `--scan-mask`."""
    detail = (
        "grain where the scan ends, from 0, none, to 1, without a step in its spectrum; a number "
        "counts from where the spectrum falls away (default: 1, but only below the texels of the "
        "map, where the skin has more than these)"
    )
    parser.add_argument("--detail", type=float, metavar="D", help=detail)
    fill = (
        "let grown skin fill in where the scan is flat, masked out or missing, with a border so "
        "wide, in the unit of --scale, from which on skin at rest is the scan (default: 0, none)"
    )
    parser.add_argument("--fill", type=float, metavar="W", help=fill)
    mask = (
        "where the scan counts: grey images by UDIM, or ANY.<UDIM>.png for all, as they lie in the "
        "UV of the mesh (--flip does not turn them); lines in what is black are not traced"
    )
    add_several(parser, "--scan-mask", type=map_file, metavar="IMAGE", help=mask)


def refuse_without_scan(arguments: argparse.Namespace) -> None:
    """End with a usage error where an option says how to read a scan, and none is given."""
    given = {
        "--scale": arguments.scale,
        "--midlevel": arguments.midlevel,
        "--scan-unit": arguments.scan_unit,
        "--flip": arguments.flip,
        "--partial": arguments.partial or None,
        "--detail": getattr(arguments, "detail", None),
        "--fill": getattr(arguments, "fill", None),
        "--scan-mask": getattr(arguments, "scan_mask", None) or None,
    }
    for option, value in given.items():
        if value is not None and not arguments.scan:
            arguments.usage_error(f"{option} says how to read displacement: give --scan, too")


def scan_settings(arguments: argparse.Namespace) -> ScanSettings:
    """What the options say of a scan. Raises SettingsError naming the setting."""
    scales = None if arguments.scale is None else tuple(arguments.scale)
    level, unit = arguments.midlevel, arguments.scan_unit
    # Of commands that make lines of a scan.
    more = (getattr(arguments, name, None) for name in ("detail", "fill"))
    return ScanSettings(scales, level, unit, arguments.flip, arguments.partial, *more)


def checked_scan(
    arguments: argparse.Namespace,
    files: list[Path],
    mesh: Mesh,
    unit: str,
    warnings: RunWarnings,
) -> ScanCheck:
    """The maps in `files` with what the options say of them, measured on their mesh; what is
    probably wrong is added to `warnings`.

    unit: of the mesh. Raises InputError and SettingsError naming the file or the option.
    """
    from rhytid.baking.inputs import measured_scan

    with options_named():
        settings = scan_settings(arguments)
        masks = getattr(arguments, "scan_mask", ())
        return measured_scan(files, mesh, settings, unit, warnings, masks)


def add_scan(group: Arguments) -> None:
    """Add the options of skin that is scanned."""
    scan = f"{SCAN_FILES}; its lines are traced and move, at rest it stays as it is"
    add_several(group, "--scan", type=map_file, metavar="MAP", help=scan)
    add_scan_settings(group)
    add_traced_settings(group)
    residual = "what --graph does not draw of a scan, as `trace` writes it; added to every map"
    add_several(group, "--residual", type=map_file, metavar="FILE", help=residual)


def refuse_scan_conflicts(arguments: argparse.Namespace) -> None:
    """End with a usage error where options of a scan exclude each other, or have no effect."""
    refuse_without_scan(arguments)
    if arguments.scan and arguments.graph is not None:
        arguments.usage_error("--scan is traced to a graph, --graph gives one: use one")
    if arguments.residual and arguments.graph is None and arguments.asset is None:
        arguments.usage_error("--residual is what a traced graph does not draw: give --graph, too")


@contextmanager
def options_named() -> Iterator[None]:
    """Name options in errors of the block where these name settings of a scan."""
    try:
        yield
    except InputError as error:
        said = _SETTING.sub(lambda found: _OPTIONS[found[1]], str(error))
        raise type(error)(said) from error
