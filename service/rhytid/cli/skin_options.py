"""Options of skin that is grown, the same in every command that grows it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.baking.request import SkinRequest
from rhytid.cli.options import add_several, existing, map_file, readable
from rhytid.cli.parser import Parser, suggestion
from rhytid.cli.scan_options import scan_settings
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import LINES
from rhytid.domain.lengths import SKIN
from rhytid.domain.painted_maps import CONTROLS, REGION_MAPS, REGION_PREFIX
from rhytid.domain.scan import ScanSettings
from rhytid.domain.skin import ANATOMIES, REGIONS, WHOLE_FACE
from rhytid.errors import SettingsError

if TYPE_CHECKING:
    from rhytid.domain.mesh import Mesh
    from rhytid.domain.painted_maps import Controls

# Settings of `graph` of which each determines the other.
_DENSITY = ("spacing", "wrinkles")
_SETTINGS = (
    *("age", "density", "strength", "turn", "anisotropy", "scale", "pore_radius"),
    *("rank", "patches", "events"),
)
# Those that are no numbers, and what they may be.
_WORDS = {"anatomy": ANATOMIES}
_MASKED = [name.removeprefix(REGION_PREFIX) for name in REGION_MAPS]
# Of these options one that is given beside a graph would have no effect.
_GROWING = ("lines", "shapes", "region", "set", "map", "region_mask")


def add_skin(command: Parser, *, graph: bool = False) -> argparse._ArgumentGroup:
    """Add the options of skin as a group, and return it.  graph: whether `--graph` is among
    them."""
    parser = command.add_argument_group("skin")
    group = add_density(parser)
    if graph:
        given = "take the wrinkles from safetensors, with their depth and unit; grow none"
        group.add_argument("--graph", type=readable, metavar="FILE", help=given)
    seed = "another seed gives another skin of the same kind (default: 1)"
    parser.add_argument("--seed", type=int, metavar="S", help=seed)
    _add_lines(parser)
    skin = f"what skin the mesh has where no mask says otherwise (default: {WHOLE_FACE})"
    parser.add_argument("--region", choices=REGIONS, help=skin)
    words = [f"{name} ({' or '.join(values)})" for name, values in _WORDS.items()]
    settings = f"a setting for the whole mesh: {', '.join([*_SETTINGS, *words])}"
    command.settings = {name: f"--set {name}=VALUE" for name in (*_SETTINGS, *_WORDS)}
    add_several(parser, "--set", type=_setting, metavar="NAME=VALUE", help=settings)
    maps = [name for name in CONTROLS if name not in REGION_MAPS]
    painted = "grey PNG or EXR painted in UV, by UDIM, or ANY.<UDIM>.png for all; NAME: "
    painted += ", ".join(maps)
    add_several(parser, "--map", type=_named(maps), metavar="NAME=FILE", help=painted)
    mask = "grey PNG or EXR, white where skin is of that region: " + ", ".join(_MASKED)
    masked = _named(_MASKED, REGION_PREFIX)
    add_several(parser, "--region-mask", type=masked, metavar="REGION=FILE", help=mask)
    return parser


def add_settings(parser: argparse._ActionsContainer, more: str = "") -> None:
    """Add `--settings`.  more: what its help says beside what the file is."""
    help_ = "asset settings as JSON" + more
    parser.add_argument("--settings", type=readable, metavar="FILE", help=help_)


def add_density(parser: argparse._ActionsContainer) -> argparse._ActionsContainer:
    """Add `--spacing S` and `--wrinkles N`, which exclude each other, and return their group."""
    group = parser.add_mutually_exclusive_group()
    usual = f"distance between pores, mesh units (default: {SKIN.spacing:g} mm through the unit)"
    group.add_argument("--spacing", type=float, metavar="S", help=usual)
    count = (
        "how many wrinkles to grow on skin of density 1; regions that expressions show and painted "
        "maps make it more or fewer (default: as many as that spacing makes)"
    )
    group.add_argument("--wrinkles", type=int, metavar="N", help=count)
    return group


def density(arguments: argparse.Namespace) -> dict[str, Any]:
    """The setting of `graph` that `--spacing` or `--wrinkles` gives; empty without either."""
    given = {name: getattr(arguments, name) for name in _DENSITY}
    return {name: value for name, value in given.items() if value is not None}


def _add_lines(parser: argparse._ActionsContainer) -> None:
    """Add `--lines` and `--shapes`, which say how the lines of the skin grow."""
    lines = "along the folds of expressions, or level (default: auto, by expressions if any)"
    parser.add_argument("--lines", choices=LINES, help=lines)
    shapes = (
        "expressions: npz with 'shapes' and 'names' or with 'frames', npy, a geometry cache, or a "
        "folder of OBJ (default: those of the mesh file)"
    )
    parser.add_argument("--shapes", type=existing, metavar="FILE|DIR", help=shapes)


def refuse_without_effect(arguments: argparse.Namespace) -> None:
    """End with a usage error where `--graph` or `--scan` stands beside an option of how skin
    grows."""
    given = ("--graph", "are grown") if arguments.graph is not None else ("--scan", "are traced")
    if arguments.graph is None and (not arguments.scan or getattr(arguments, "fill", None)):
        return
    for name in _GROWING:
        if getattr(arguments, name):
            option = "--" + name.replace("_", "-")
            arguments.usage_error(
                f"{option} says how lines grow, {given[0]} gives lines that {given[1]}: use one"
            )


def skin_settings(
    arguments: argparse.Namespace, given: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Settings of an asset, as JSON: those given, overridden by the options."""
    settings = dict(given or {})
    graph = {"seed": arguments.seed, "lines": arguments.lines, "region": arguments.region}
    graph = {name: value for name, value in graph.items() if value is not None}
    graph |= density(arguments)
    for name, value in graph.items():
        check_typed(name, value, f"--{name}")
    for name, value in arguments.set:
        check_typed(name, value, f"--set {name}")
    graph |= dict(arguments.set)
    if graph:
        beside = dict(settings.get("graph", {}))
        if density(arguments):  # one of them fixes the other
            beside = {name: value for name, value in beside.items() if name not in _DENSITY}
        settings["graph"] = {**beside, **graph}
    if arguments.unit is not None:
        settings["unit"] = arguments.unit
    return settings


def check_typed(name: str, value: Any, typed: str) -> None:
    """Raise SettingsError where a setting of `graph` is wrong by itself, by what was typed."""
    try:
        AssetSettings.parse({"graph": {name: value}})
    except SettingsError as error:
        path, told = f"graph.{name} is ", str(error)
        if told.startswith(path):
            told = told.removeprefix(path)
            if isinstance(value, float):  # 80 was typed, not 80.0
                told = told.replace(str(value), f"{value:g}", 1)
            raise SettingsError(f"{typed} is {told}") from error


def asset_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """The settings of `--settings`, overridden by the options. Raises SettingsError naming what is
    wrong."""
    settings = given_settings(arguments)
    if arguments.resolution is not None:
        settings["resolution"] = arguments.resolution
    return skin_settings(arguments, settings)


def given_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """The settings of `--settings`; empty without it. Raises SettingsError naming what is wrong."""
    if arguments.settings is None:
        return {}
    try:
        given = json.loads(arguments.settings.read_bytes())
    except RecursionError as exc:
        raise SettingsError(f"{arguments.settings} is JSON nested too deeply") from exc
    except ValueError as exc:
        raise SettingsError(f"{arguments.settings} is not JSON: {exc}") from exc
    try:
        AssetSettings.parse(given)
    except SettingsError as exc:
        raise SettingsError(f"{arguments.settings}: {exc}") from exc
    return dict(given)


def skin_request(arguments: argparse.Namespace) -> SkinRequest:
    """The skin that the arguments ask for. Raises what `asset_settings` does."""
    return SkinRequest(
        settings=asset_settings(arguments),
        graph=arguments.graph,
        stiffness=arguments.stiffness,
        maps=skin_maps(arguments),
        shapes=arguments.shapes,
        force=arguments.force,
        residual=arguments.residual,
        scan=arguments.scan,
        scan_settings=scan_settings(arguments) if arguments.scan else ScanSettings(),
        scan_masks=getattr(arguments, "scan_mask", ()),
    )


def skin_maps(arguments: argparse.Namespace) -> dict[str, list[Path]]:
    """Files of painted maps and masks, by the name of the control."""
    masks = [(REGION_PREFIX + region, file) for region, file in arguments.region_mask]
    files: dict[str, list[Path]] = {}
    for name, file in [*arguments.map, *masks]:
        files.setdefault(name, []).append(file)
    return files


def skin_controls(arguments: argparse.Namespace, mesh: Mesh) -> Controls | None:
    """The painted maps and masks of a mesh, read and checked."""
    from rhytid.baking.input_files import control_files

    return control_files(skin_maps(arguments), mesh)


def _setting(text: str) -> tuple[str, float | str]:
    name, _, value = text.partition("=")
    known = _one_of((*_SETTINGS, *_WORDS), name)
    if known in _WORDS:
        return known, _one_of(_WORDS[known], value)
    try:
        return known, float(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r}: {name} needs a number, as {name}=1.5"
        ) from error


def _named(names: Sequence[str], prefix: str = "") -> Any:
    """Reads NAME=FILE.  prefix: that the name may have in front."""

    def named(text: str) -> tuple[str, Path]:
        name, equals, file = text.partition("=")
        if not (equals and file):
            raise argparse.ArgumentTypeError(f"{text!r}: write it as NAME=FILE")
        return _one_of(names, name.removeprefix(prefix)), map_file(file)

    return named


def _one_of(names: Sequence[str], name: str) -> str:
    if name not in names:
        known = ", ".join(names)
        raise argparse.ArgumentTypeError(f"{name!r}: one of {known}{suggestion(name, names)}")
    return name
