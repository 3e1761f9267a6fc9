"""Options that guide synthesis: settings for the whole mesh, and maps painted in UV."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rhytid.cli.options import add_several, readable
from rhytid.domain.controls import CONTROLS, REGION_MAPS, REGION_PREFIX
from rhytid.domain.regions import REGIONS

_SETTINGS = ("age", "density", "strength", "turn", "anisotropy", "scale", "pore_radius")
_MASKED = [name.removeprefix(REGION_PREFIX) for name in REGION_MAPS]


def add_controls(parser: argparse.ArgumentParser) -> None:
    """`--region`, `--set NAME=VALUE`, `--map NAME=FILE` and `--region-mask REGION=FILE`."""
    skin = "what skin the mesh has, where no mask says otherwise"
    parser.add_argument("--region", choices=REGIONS, help=skin)
    settings = ", ".join(_SETTINGS)
    add_several(parser, "--set", type=_setting, metavar="NAME=VALUE", help=settings)
    maps = [name for name in CONTROLS if name not in REGION_MAPS]
    painted = "grey PNG or EXR painted in UV, named ANY.<UDIM>.png; NAME: " + ", ".join(maps)
    add_several(parser, "--map", type=_named(maps), metavar="NAME=FILE", help=painted)
    mask = "grey PNG or EXR, white where skin is of that region: " + ", ".join(_MASKED)
    add_several(parser, "--region-mask", type=_named(_MASKED), metavar="REGION=FILE", help=mask)


def control_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """Settings by their names in `graph`; None where not given."""
    return {"region": arguments.region, **dict(arguments.set)}


def control_maps(arguments: argparse.Namespace) -> dict[str, list[Path]]:
    """Files by the name of their control."""
    masks = [(REGION_PREFIX + region, file) for region, file in arguments.region_mask]
    files: dict[str, list[Path]] = {}
    for name, file in [*arguments.map, *masks]:
        files.setdefault(name, []).append(file)
    return files


def _setting(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return _one_of(_SETTINGS, name), float(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r}: {name} needs a number, as {name}=1.5"
        ) from error


def _named(names: Sequence[str]) -> Any:
    def named(text: str) -> tuple[str, Path]:
        name, equals, file = text.partition("=")
        if not (equals and file):
            raise argparse.ArgumentTypeError(f"{text!r}: write it as NAME=FILE")
        return _one_of(names, name), readable(file)

    return named


def _one_of(names: Sequence[str], name: str) -> str:
    if name not in names:
        raise argparse.ArgumentTypeError(f"{name!r}: one of {', '.join(names)}")
    return name
