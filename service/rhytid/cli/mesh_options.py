"""The options of how mesh files are read: units, and the animation that is meant."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rhytid.cli.argument_types import rate, readable, unit_name
from rhytid.domain.lengths import MILLIMETRES, USUAL_UNIT
from rhytid.formats.frame_set import Clip

if TYPE_CHECKING:
    from rhytid.formats.meshes import MeshFile

# What the commands read.
MESH_FILES = "OBJ, PLY, glTF, GLB, npz or USD"
FRAME_FILES = "npy, OBJ, npz with 'frames', USD, animated glTF or GLB, MDD or PC2"


def add_mesh(
    parser: argparse._ActionsContainer,
    name: str,
    help: str = MESH_FILES,
    *,
    required: bool = True,
) -> None:
    """The neutral mesh, as an argument or by `--mesh`: either sets `mesh`."""
    one = parser.add_mutually_exclusive_group(required=required)
    one.add_argument("mesh", nargs="?", action=_Given, type=readable, metavar=name, help=help)
    same = f"the same as {name}, which stands before options of several values"
    one.add_argument("--mesh", type=readable, metavar=name, help=same)


class _Given(argparse.Action):
    """Sets what is given; leaves alone what another argument has set where nothing is."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        if values is not None:
            setattr(namespace, self.dest, values)


def add_unit(
    parser: argparse._ActionsContainer,
    what: str,
    default: str = "that of a graph or of a USD file which names one, else cm",
) -> None:
    """`--unit U`, the length unit of `what`."""
    known = ", ".join(name for name in MILLIMETRES if name.isascii())
    unit = f"length unit of {what}: {known}, or so many of one, as 5.5cm (default: {default})"
    parser.add_argument("--unit", type=unit_name, metavar="U", help=unit)


def length_unit(arguments: argparse.Namespace, file: MeshFile) -> str:
    """The unit that `--unit` names, else that of the mesh file, else the usual one."""
    return arguments.unit or file.unit or USUAL_UNIT


def add_prim(parser: argparse._ActionsContainer) -> None:
    """`--prim`: which mesh of a USD stage is meant."""
    prim = "path or name of a mesh, where a USD stage has several"
    parser.add_argument("--prim", metavar="PATH", help=prim)


def prim_clip(prim: str | None) -> Clip:
    """What `--prim` says, for a command that takes no animation."""
    return Clip(prim=prim)


def add_fps(parser: argparse._ActionsContainer, help: str) -> None:
    """`--fps`: frames per second."""
    parser.add_argument("--fps", type=rate, default=24.0, metavar="F", help=help)


def add_caches(parser: argparse._ActionsContainer) -> None:
    """`--prim`, `--clip` and `--fps`: which animation of a geometry cache is meant."""
    add_prim(parser)
    clip = "name or number of an animation, where a glTF has several"
    parser.add_argument("--clip", metavar="NAME", help=clip)
    add_fps(parser, "frames per second that glTF and MDD, which have times, are counted by")


def cache_clip(arguments: argparse.Namespace) -> Clip:
    """The clip that these options choose."""
    return Clip(arguments.prim, arguments.clip, arguments.fps)
