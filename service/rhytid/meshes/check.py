"""Everything that can be said of a mesh before anything is made of it, and its table for
`rhytid check`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.blendshapes import region_of
from rhytid.domain.lengths import millimetres, unit_after_number
from rhytid.domain.mesh import Mesh, add_centre
from rhytid.domain.notices import Notice, build_notice, texel_notice
from rhytid.domain.tiles import udim_origin
from rhytid.domain.uv_layout import usual_uv_length
from rhytid.domain.warnings import LEAST_SIZE, MOST_SIZE, TEXEL_RATIO
from rhytid.domain.wording import plural
from rhytid.errors import MeshError
from rhytid.formats.meshes import MeshFile
from rhytid.meshes.layout import Layout
from rhytid.meshes.topology import Topology, distinct
from rhytid.synthesis.build_size import BuildSize, RequestedCount
from rhytid.synthesis.surface import Surface

Mask = NDArray[np.bool_]
Row = tuple[str, str, str]
# Listed of each kind: places of the largest triangles, the longest borders, the largest parts.
PLACES = 8
HEADER = ("what", "found", "where")


@dataclass(frozen=True)
class Place:
    """Where a triangle lies: its number in the file, and its middle in UV and in the space of the
    file."""

    triangle: int
    uv: tuple[float, float]
    at: tuple[float, float, float]

    def __str__(self) -> str:
        at = ", ".join(f"{x:.4g}" for x in self.at)
        return f"triangle {self.triangle}, uv ({self.uv[0]:.3f}, {self.uv[1]:.3f}), at ({at})"


@dataclass(frozen=True, eq=False)
class MeshCheck:
    """A mesh file and the findings about it.

    unit: of its lengths.  resolution: texels per side.
    """

    file: MeshFile
    unit: str
    resolution: int
    topology: Topology
    layout: Layout

    @classmethod
    def of(cls, file: MeshFile, unit: str, resolution: int) -> MeshCheck:
        """The check of the mesh of a file."""
        mesh = file.mesh
        return cls(file, unit, resolution, Topology.of(mesh), Layout.of(mesh, unit, resolution))

    @property
    def mesh(self) -> Mesh:
        """The neutral mesh."""
        return self.file.mesh

    def problems(self) -> dict[str, Mask]:
        """Masks (F,) of the triangles with each kind of problem, by its name in `figures`."""
        found = self.topology
        return {
            "boundary": found.loop >= 0,
            "non_manifold": found.at_non_manifold,
            "flipped": found.flipped,
            "degenerate": found.degenerate,
            "flat_in_uv": self.layout.flat,
            "uv_overlap": self.layout.overlapping,
            "uv_mirrored": self.layout.mirrored,
        }

    def uneven_texels(self) -> dict[str, Mask]:
        """The mask (F,) of triangles whose texels are TEXEL_RATIO times larger than the smallest,
        or smaller than the largest, by its name; none where the spread is no larger than that."""
        side = self.layout.texels
        least, median, most = side[list(self.layout.extremes)]
        if most <= TEXEL_RATIO * least:
            return {}
        coarse = most / median >= median / least
        if coarse:
            return {"coarse_texels": side > TEXEL_RATIO * least}
        return {"fine_texels": side < most / TEXEL_RATIO}

    def places(self, mask: Mask) -> list[Place]:
        """The places of the largest triangles of a mask (F,), at most PLACES."""
        rows = np.flatnonzero(mask)
        a, b, c = np.moveaxis(self.mesh.positions[self.mesh.faces[rows]].astype(np.float64), 1, 0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return [self.place(int(rows[i])) for i in np.argsort(-area, kind="stable")[:PLACES]]

    def place(self, triangle: int) -> Place:
        """The place of a triangle."""
        u, v = self.mesh.triangle_uv()[triangle].mean(axis=0).tolist()
        middle = self.mesh.positions[self.mesh.faces[triangle]].astype(np.float64).mean(axis=0)
        x, y, z = add_centre(middle, self.mesh.centre).tolist()
        return Place(triangle, (u, v), (x, y, z))

    def figures(self) -> dict[str, Any]:
        """All findings, for JSON; lengths in the unit of the mesh."""
        return {
            "unit": self.unit,
            "resolution": self.resolution,
            "size": self.size(),
            **self._surface(),
            "uv": self._uv(),
            "texels": self.texel_sizes(),
            "build": None if self.build is None else self.build.figures(),
            "shapes": self.shapes(),
            "frames": 0 if self.file.frames is None else len(self.file.frames),
        }

    @cached_property
    def build(self) -> BuildSize | None:
        """How much skin the usual spacing gives; None for a unit of no known length, and where no
        triangle can carry skin."""
        if millimetres(self.unit) is None:
            return None
        settings = self.settings.for_synthesis().graph
        try:
            surface = Surface.of(self.mesh)
        except MeshError:
            return None
        area = float(surface.area.sum()) * surface.scale**2
        return BuildSize.of(self.mesh, round(RequestedCount.of(settings, area).wrinkles))

    @property
    def settings(self) -> AssetSettings:
        """The settings of an asset of this mesh, where nothing but unit and resolution is given."""
        return AssetSettings.parse({"unit": self.unit, "resolution": self.resolution})

    def notices(self) -> tuple[Notice, ...]:
        """Notices about an asset of this mesh, before it is built."""
        if self.build is None:
            return ()
        texels = texel_notice(self.settings.for_synthesis(), usual_uv_length(self.mesh))
        return (*texels, *build_notice(self.build.wrinkles))

    def size(self) -> dict[str, Any]:
        """The box around the mesh, and the usual size of heads."""
        used = self.mesh.positions[distinct(self.mesh.faces)].astype(np.float64)
        sides = np.ptp(used, axis=0).tolist()
        length = millimetres(self.unit)
        return {
            "box": sides,
            "longest": max(sides),
            "longest_mm": None if length is None else max(sides) * length,
            "usual_mm": [LEAST_SIZE, MOST_SIZE],
        }

    def texel_sizes(self) -> dict[str, Any]:
        """The smallest, the median and the largest side of a texel on the surface, and where each
        is."""
        length = millimetres(self.unit)
        found = {}
        for name, triangle in zip(("least", "median", "most"), self.layout.extremes, strict=True):
            side = float(self.layout.texels[triangle])
            in_mm = None if length is None else side * length
            found[name] = {"side": side, "mm": in_mm, "place": asdict(self.place(triangle))}
        return found

    def shapes(self) -> dict[str, Any]:
        """The expressions in the file, and the regions that their names point to."""
        shapes = self.file.shapes
        names = [] if shapes is None else list(shapes.names)
        regions: dict[str, list[str]] = {}
        for name in names:
            region = region_of(name)
            if region is not None:
                regions.setdefault(region, []).append(name)
        if "lip" in regions:  # the mouth is what these carry along around the lips
            regions["mouth"] = regions["lip"]
        count = 0 if shapes is None else len(shapes)
        return {"count": count, "names": names, "regions": regions}

    def _surface(self) -> dict[str, Any]:
        found, problems = self.topology, self.problems()
        named = ("non_manifold", "flipped", "degenerate")
        return {
            "vertices": len(self.mesh.positions),
            "split_vertices": found.split,
            "unused_vertices": found.unused,
            "triangles": len(self.mesh.faces),
            "components": {
                "count": found.components,
                "largest": np.bincount(found.component)[:PLACES].tolist(),
            },
            "boundary_loops": {
                "count": found.loops,
                "longest": [self._loop(number) for number in range(min(found.loops, PLACES))],
            },
            "non_manifold_edges": found.non_manifold,
            "inconsistent_edges": found.inconsistent,
            "twisted_components": found.twisted,
            "triangles_with": {name: self._listed(problems[name]) for name in named},
        }

    def _uv(self) -> dict[str, Any]:
        layout = self.layout
        overlaps = [
            {
                "udim": udim,
                "share": one.share,
                "most": one.most,
                "uv": [x + y for x, y in zip(one.uv, udim_origin(udim), strict=True)],
            }
            for udim, one in layout.overlaps.items()
        ]
        return {
            "udims": list(layout.udims),
            "charts": layout.charts,
            "overlaps": overlaps,
            "overlapping": self._listed(layout.overlapping),
            "mirrored_share": layout.mirrored_share,
            "mirrored": self._listed(layout.mirrored),
            "flat": self._listed(layout.flat),
        }

    def _loop(self, number: int) -> dict[str, Any]:
        at = self.place(int(np.argmax(self.topology.loop == number)))
        length = float(self.topology.loop_lengths[number])
        edges = int(self.topology.loop_edges[number])
        return {"edges": edges, "length": length, "place": asdict(at)}

    def _listed(self, mask: Mask) -> dict[str, Any]:
        return {"count": int(mask.sum()), "places": [asdict(p) for p in self.places(mask)]}


def rows(check: MeshCheck, figures: dict[str, Any]) -> list[Row]:
    """The rows of the table: a finding, how much there is of it, and the first place.

    figures: those of the check.
    """
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
        named = (
            "; regions that the shapes show have more or fewer" if check.shapes()["regions"] else ""
        )
        yield "skin at the usual spacing", f"{check.build}{named}", ""


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
