"""What `rhytid check` found, as the rows of a table."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rhytid.domain.lengths import unit_after_number
from rhytid.domain.wording import plural
from rhytid.meshes.check import MeshCheck

HEADER = ("what", "found", "where")
Row = tuple[str, str, str]


def rows(check: MeshCheck, figures: dict[str, Any]) -> list[Row]:
    """What there is, how much, and the first place of it.  figures: those of the check."""
    return [
        *_size(figures),
        *_surface(check, figures),
        *_uv(check, figures),
        *_texels(check, figures),
        *_skin(check),
        *_motion(figures),
    ]


def _size(figures: dict[str, Any]) -> Iterator[Row]:
    size, unit = figures["size"], figures["unit"]
    box = " x ".join(f"{side:.4g}" for side in size["box"])
    low, high = size["usual_mm"]
    named = unit_after_number(unit)
    found = f"{box} {unit}" if named == unit else f"({box}) {named}"
    if size["longest_mm"] is None:
        yield "size", f"{found}; no known unit of length", ""
    else:
        usual = f"a face or a head has {low:g} to {high:g} mm"
        yield "size", f"{found}, longest {size['longest_mm']:.4g} mm; {usual}", ""


def _surface(check: MeshCheck, figures: dict[str, Any]) -> Iterator[Row]:
    split, unused = figures["split_vertices"], figures["unused_vertices"]
    yield (
        "vertices",
        f"{figures['vertices']}, {split} at the place of another, {unused} unused",
        "",
    )
    yield "triangles", str(figures["triangles"]), ""
    parts = figures["components"]
    largest = ", ".join(str(count) for count in parts["largest"])
    yield "components", f"{parts['count']}, of triangles: {_some(largest, parts)}", ""
    yield _loops(figures["boundary_loops"], figures["unit"])
    edges = figures["non_manifold_edges"]
    yield "non-manifold edges", str(edges), _first(check, "non_manifold")
    turned = figures["triangles_with"]["flipped"]["count"]
    against = f"{plural(turned, 'triangle')}, {plural(figures['inconsistent_edges'], 'edge')}"
    if figures["twisted_components"]:
        against += (
            f"; {plural(figures['twisted_components'], 'component')} cannot be wound consistently"
        )
    yield "wound against the rest", against, _first(check, "flipped")
    flat = figures["triangles_with"]["degenerate"]["count"]
    yield "without area in space", plural(flat, "triangle"), _first(check, "degenerate")


def _loops(loops: dict[str, Any], unit: str) -> Row:
    if not loops["count"]:
        return "boundary loops", "0: the surface is closed", ""
    lengths = ", ".join(f"{loop['length']:.4g}" for loop in loops["longest"])
    first = loops["longest"][0]["place"]
    at = f"triangle {first['triangle']}"
    long = f"{unit} long" if unit_after_number(unit) == unit else f"in units of {unit}"
    return "boundary loops", f"{loops['count']}, {long}: {lengths}", at


def _uv(check: MeshCheck, figures: dict[str, Any]) -> Iterator[Row]:
    uv = figures["uv"]
    yield "UDIMs", " ".join(str(udim) for udim in uv["udims"]) or "none", ""
    yield "UV charts", str(uv["charts"]), ""
    yield "without area in UV", plural(uv["flat"]["count"], "triangle"), _first(check, "flat_in_uv")
    for one in uv["overlaps"] or [None]:
        share = "none" if one is None else f"{_percent(one['share'])} of UDIM {one['udim']}"
        many = "" if one is None else f", up to {one['most']} triangles at a point"
        at = "" if one is None else f"uv ({one['uv'][0]:.3f}, {one['uv'][1]:.3f})"
        yield "UV overlap", share + many, at
    count = plural(uv["mirrored"]["count"], "triangle")
    mirrored = f"{_percent(uv['mirrored_share'])} of the area, {count}"
    yield "UV mirrored", mirrored, _first(check, "uv_mirrored")


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _texels(check: MeshCheck, figures: dict[str, Any]) -> Iterator[Row]:
    for name, triangle in zip(("least", "median", "most"), check.layout.extremes, strict=True):
        found = figures["texels"][name]
        length, unit = (found["side"], figures["unit"]), (found["mm"], "mm")
        side, named = length if found["mm"] is None else unit
        at = f"{side:.3g} {named} at {check.resolution} x {check.resolution}"
        yield f"texel, {name}", at, str(check.place(triangle))


def _skin(check: MeshCheck) -> Iterator[Row]:
    if check.build is not None:
        yield "skin at the usual spacing", str(check.build), ""


def _motion(figures: dict[str, Any]) -> Iterator[Row]:
    shapes, frames = figures["shapes"], figures["frames"]
    regions = ", ".join(f"{len(names)} of {region}" for region, names in shapes["regions"].items())
    known = f"; names tell of regions: {regions}" if regions else ""
    yield "shapes", f"{shapes['count']}{known}", ""
    yield "frames", str(frames), ""


def _some(listed: str, parts: dict[str, Any]) -> str:
    return f"{listed}, …" if parts["count"] > len(parts["largest"]) else listed


def _first(check: MeshCheck, kind: str) -> str:
    """The largest triangle with a problem, as a place."""
    places = check.places(check.problems()[kind])
    return str(places[0]) if places else ""
