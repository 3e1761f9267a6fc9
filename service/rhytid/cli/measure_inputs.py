"""What `rhytid measure` measures: the places, and the skin or the scan at them."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from functools import cache
from typing import TypeVar

from rhytid.baking.assets import build
from rhytid.baking.frames import FrameFiles
from rhytid.baking.input_files import graph_file, shape_files
from rhytid.baking.inputs import new_asset
from rhytid.baking.run_warnings import RunWarnings
from rhytid.cli.measure_patches import (
    Heights,
    PatchError,
    Place,
    Positions,
    Source,
    of_asset,
    of_scan,
)
from rhytid.cli.options import cache_clip, length_unit
from rhytid.cli.preview import skin_views
from rhytid.cli.preview_spots import flat_spots, spot_at
from rhytid.cli.scan_options import checked_scan
from rhytid.cli.service_options import service_settings
from rhytid.cli.skin_options import given_settings, skin_controls, skin_request
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Folds, expressions_for_lines
from rhytid.domain.lengths import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.domain.skin import FINE
from rhytid.domain.tiles import busiest_udim, triangles_inside
from rhytid.domain.warnings import PATCH_SIZE, InputWarning
from rhytid.engine.engine import Engine, open_device
from rhytid.errors import InputError
from rhytid.formats.meshes import MeshFile
from rhytid.pictures.surface_patch import Frame
from rhytid.pipeline.folds import measured_folds
from rhytid.support.console import share_bar, working
from rhytid.support.settings import ServiceSettings
from rhytid.support.temporary_folders import temporary_folder
from rhytid.synthesis.workspace import directly

Asked = TypeVar("Asked")
Found = TypeVar("Found")
# Folds that show regions are measured with it.
_LIMIT = AssetSettings().response.log_stretch_limit
# Sizes that are tried, in tens of millimetres, millimetres or tenths.
_STEPS = (9, 8, 7, 6, 5, 4, 3, 2.5, 2, 1.5, 1)


def unit_of(arguments: argparse.Namespace, read: MeshFile) -> str:
    """The unit of the mesh: of `--unit`, of `--settings`, of the graph, of the file, or the usual
    one."""
    given = arguments.unit or given_settings(arguments).get("unit")
    if given is None and arguments.graph is not None:
        origin = graph_file(arguments.graph).origin
        given = None if origin is None else origin.unit
    return str(given or length_unit(arguments, read))


def _unit_mm(unit: str) -> float:
    return millimetres(unit) or MILLIMETRES[USUAL_UNIT]


def places_of(
    arguments: argparse.Namespace,
    read: MeshFile,
    unit: str,
    warnings: RunWarnings,
    folds: Folds | None,
) -> list[Place]:
    """The patches that are asked for; else the flattest places. Warns of those that reach beyond
    the mesh, and raises PatchError where all do, InputError naming a place that is not on it.

    folds: what `folds_of` gives.
    """
    mesh, degrees = read.mesh, arguments.along
    regions = _regions(arguments, read, folds) if arguments.place else lambda side: []

    @cache  # patches that do not fit try the same sizes
    def chosen(size: float) -> list[Place]:
        side = size / _unit_mm(unit)
        found = regions(side)
        for one in arguments.patch:
            found += Place.all(spot_at(mesh, one, side), mesh, degrees)
        return found or Place.all(flat_spots(mesh, [side]), mesh, degrees)

    with working("placing patches"):
        found = chosen(arguments.size)
    if not found:
        raise InputError(
            f"no patch of {arguments.size:g} mm lies flat on the mesh: give --patch, or a smaller "
            "--size"
        )

    def checked(number: int) -> Place:
        try:
            return found[number].on(mesh, arguments.size / _unit_mm(unit))
        except PatchError as error:
            sizes = (s for s in _sizes_below(arguments.size) if fits(chosen(s)[number], s))
            raise PatchError(error.name, error.missing, next(sizes, None)) from None

    def fits(place: Place, size: float) -> bool:
        with suppress(PatchError):
            return place.on(mesh, size / _unit_mm(unit)) is place
        return False

    with working("looking whether patches fit"):
        return those_that_fit(range(len(found)), checked, warnings)


def those_that_fit(
    asked: Iterable[Asked], measure: Callable[[Asked], Found], warnings: RunWarnings
) -> list[Found]:
    """What `measure` gives of each that is asked for. Warns of those of which it raises PatchError;
    raises the first where it does so of all, and StrictError."""

    def attempt(one: Asked) -> Found | PatchError:
        try:
            return measure(one)
        except PatchError as error:
            return error

    every = [attempt(one) for one in asked]
    beyond = [one for one in every if isinstance(one, PatchError)]
    found = [one for one in every if not isinstance(one, PatchError)]
    if not found:
        raise beyond[0]
    for patch in beyond:
        where = f"patch {patch.name}"
        warnings.add([InputWarning(PATCH_SIZE, f"left out: {patch.detail}", where)])
    warnings.refuse()
    return found


def _sizes_below(size: float) -> Iterator[float]:
    """Sizes to try in place of one that is too large, the largest first, to a tenth of it."""
    ten = 10.0 ** math.floor(math.log10(size))
    for tens in (ten, ten / 10):
        yield from (n * tens for n in _STEPS if 0.1 * size <= n * tens < size)


def _regions(
    arguments: argparse.Namespace, read: MeshFile, folds: Folds | None
) -> Callable[[float], list[Place]]:
    """What gives patches of a side in mesh units, of the regions that are painted or that folds
    show."""
    mesh, controls = read.mesh, skin_controls(arguments, read.mesh)
    udim = busiest_udim(mesh)
    corners = mesh.positions[mesh.faces[triangles_inside(mesh, udim)]].astype(float)

    def chosen(side: float) -> list[Place]:
        found = skin_views(mesh, folds, udim, side, controls, arguments.place)
        views = {view.region: view for view in found}
        if beyond := [name for name in arguments.place if name not in views]:
            raise InputError(
                f"--place {beyond[0]}: no triangle of it is in UDIM {udim}, which has most: give "
                "--patch"
            )
        return [
            Place.of(name, mesh, udim, Frame.of(corners[views[name].triangle]), arguments.along)
            for name in arguments.place
        ]

    return chosen


def folds_of(arguments: argparse.Namespace, read: MeshFile, unit: str) -> Folds | None:
    """The folds of the mesh, which show the regions that are asked for; None where all of these are
    painted. Raises InputError where the expressions do not show one."""
    painted = [name for name, _ in arguments.region_mask]
    regions = [name for name in arguments.place if name not in painted]
    if not regions:
        return None
    shapes = shape_files(arguments.shapes, read, cache_clip(arguments))
    expressions = expressions_for_lines(arguments.lines, shapes)
    if expressions is None:
        raise InputError(
            f"--place {regions[0]} needs expressions of known names or its mask: give --shapes, "
            f"--region-mask {regions[0]}=FILE, or --patch"
        )
    device = open_device(ServiceSettings.from_environment(), arguments.device)
    with share_bar("folds") as show:
        folds = measured_folds(device, read.mesh, expressions, _LIMIT, unit, show, directly)
    masks = {} if folds is None else folds.regions
    if missing := [name for name in regions if name not in masks]:
        there = ", ".join(masks) or "none"
        raise InputError(f"--place {missing[0]}: the expressions do not show it; they show {there}")
    assert folds is not None
    return folds


@contextmanager
def heights_of(
    arguments: argparse.Namespace,
    read: MeshFile,
    unit: str,
    warnings: RunWarnings,
    folds: Folds | None,
) -> Iterator[Heights]:
    """The heights of patches, of skin that is grown or of a scan.  folds: what `folds_of` gives."""

    def heights(source: Source) -> Heights:
        return Heights(
            read.mesh, source, arguments.size, _unit_mm(unit), arguments.form, arguments.cutoff
        )

    if arguments.scan:
        scan = checked_scan(arguments, arguments.scan, read.mesh, unit, warnings).scan
        yield heights(of_scan(scan))
    else:
        with _grown(arguments, read, unit, warnings, folds) as source:
            yield heights(source)


@contextmanager
def _grown(
    arguments: argparse.Namespace,
    read: MeshFile,
    unit: str,
    warnings: RunWarnings,
    folds: Folds | None,
) -> Iterator[Source]:
    """The displacement of the skin that the arguments ask for, in a store that is removed."""
    request = skin_request(arguments)
    if arguments.graph is not None:  # these are of places alone: nothing is grown
        request = replace(request, maps={}, shapes=None)
    settings = AssetSettings.parse(
        request.settings if arguments.graph else {"unit": unit, **request.settings}
    )
    warnings.inputs(read.mesh, arguments.mesh.name, settings.length_unit, settings.resolution)
    new = new_asset(request, read, settings, cache_clip(arguments), warnings)
    how = settings.length_unit, settings.response.log_stretch_limit, settings.graph.anatomy
    if how == (unit, _LIMIT, FINE):  # else the build measures its own
        new = replace(new, folds=folds)
    with temporary_folder("rhytid-") as folder:
        service = replace(service_settings(folder, arguments.device, None), build_seconds=None)
        with closing(Engine(service)) as engine:
            yield of_asset(engine, build(engine, new, warnings))


def frame_of(arguments: argparse.Namespace, read: MeshFile) -> Positions | None:
    """The positions of the frame that is asked for; None where there is none."""
    if arguments.frames is None and arguments.frame is None:
        return None
    files = [] if arguments.frames is None else [arguments.frames]
    frames, number = FrameFiles(read, files, cache_clip(arguments)), arguments.frame or 1
    if not 1 <= number <= len(frames.places):
        raise InputError(f"--frame {number}: there are frames 1 to {len(frames.places)}")
    return frames.read(frames.places[number - 1])
