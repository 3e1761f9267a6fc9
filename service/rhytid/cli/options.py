"""Options that several commands have, and types of arguments.

A type takes a word of the command line and returns its value, or raises ArgumentTypeError saying
what is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rhytid.baking.frame_names import ANY_UDIM, FrameRange, check_file_name
from rhytid.domain.lengths import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.domain.methods import SAMPLINGS, STRETCH_MODELS
from rhytid.domain.warnings import CODES
from rhytid.errors import InputError
from rhytid.exports.textures import COMPRESSIONS, PROFILE_NAMES, USUAL
from rhytid.formats.frame_set import Clip
from rhytid.support.console import STDOUT

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.formats.meshes import MeshFile

Value = TypeVar("Value")
# A parser, or a group of its options in --help.
Arguments = argparse._ActionsContainer
MOST_FPS = 10_000
# What the commands read.
MESH_FILES = "OBJ, PLY, glTF, GLB, npz or USD"
FRAME_FILES = "npy, OBJ, npz with 'frames', USD, animated glTF or GLB, MDD or PC2"


def readable(text: str) -> Path:
    """The path of an existing file."""
    if not text:
        raise argparse.ArgumentTypeError("a name of no characters: name a file")
    path = Path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is a folder: name a file in it")
    if path.exists() and not path.is_file():
        raise argparse.ArgumentTypeError(
            f"{text} is a pipe or a device, which can be read only once: write it to a file first"
        )
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"no such file: {text}")
    return path


def existing(text: str) -> Path:
    """The path of an existing file or folder."""
    if not Path(text).exists():
        raise argparse.ArgumentTypeError(f"no such file or folder: {text}")
    return Path(text)


def map_file(text: str) -> Path:
    """The path of a map, which may have `<UDIM>` in its name."""
    return Path(text) if ANY_UDIM in Path(text).name else readable(text)


def positive(text: str) -> int:
    """A whole number from 1."""
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 1")
    return int(text)


def rate(text: str) -> float:
    """Frames per second."""
    try:
        fps = float(text)
    except ValueError:
        fps = 0.0
    if not 0.0 < fps <= MOST_FPS:
        raise argparse.ArgumentTypeError(f"{text!r}: a number above 0, at most {MOST_FPS}")
    return fps


def share(text: str) -> float:
    """A number from 0 to 1."""
    try:
        found = float(text)
    except ValueError:
        found = -1.0
    if not 0.0 <= found <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r}: a number from 0 to 1")
    return found


def seconds(text: str) -> float:
    """A time of 0 to 10 seconds."""
    try:
        found = float(text)
    except ValueError:
        found = -1.0
    if not 0.0 <= found <= 10.0:
        raise argparse.ArgumentTypeError(f"{text!r}: seconds, 0 to 10")
    return found


def unit_name(text: str) -> str:
    """A length unit: a name, or a number and a name as 5.5cm."""
    if millimetres(text) is None:
        known = ", ".join(MILLIMETRES)
        raise argparse.ArgumentTypeError(f"{text!r}: one of {known}, or so many, as 5.5cm")
    return text


def _checked_by(parse: Callable[[str], Value]) -> Callable[[str], Value]:
    """Make a type of arguments of a function that raises InputError."""

    def checked(text: str) -> Value:
        try:
            return parse(text)
        except InputError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return checked


# The first part of the names of written files.
base_name = _checked_by(check_file_name)
# Frames by their numbers: `1-10,15,20-30:2`.
frame_range = _checked_by(FrameRange.parse)


def add_mesh(
    parser: argparse._ActionsContainer,
    name: str,
    help: str = MESH_FILES,
    *,
    required: bool = True,
) -> None:
    """Add the neutral mesh, as an argument and as `--mesh`. Either sets `mesh`."""
    one = parser.add_mutually_exclusive_group(required=required)
    one.add_argument("mesh", nargs="?", action=_Given, type=readable, metavar=name, help=help)
    same = f"the same as {name}, which stands before options of several values"
    one.add_argument("--mesh", type=readable, metavar=name, help=same)


class _Given(argparse.Action):
    """Stores a value that is given. Else keeps what another argument has set."""

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
    """Add `--unit U`, the length unit of `what`."""
    known = ", ".join(name for name in MILLIMETRES if name.isascii())
    unit = f"length unit of {what}: {known}, or so many of one, as 5.5cm (default: {default})"
    parser.add_argument("--unit", type=unit_name, metavar="U", help=unit)


def length_unit(arguments: argparse.Namespace, file: MeshFile) -> str:
    """The unit of `--unit`, else that of the mesh file, else the usual one."""
    return arguments.unit or file.unit or USUAL_UNIT


def add_prim(parser: argparse._ActionsContainer) -> None:
    """Add `--prim`, which mesh of a USD stage is meant."""
    prim = "path or name of a mesh, where a USD stage has several"
    parser.add_argument("--prim", metavar="PATH", help=prim)


def prim_clip(prim: str | None) -> Clip:
    """The clip of a `--prim` option, for commands that read no animation."""
    return Clip(prim=prim)


def add_fps(parser: argparse._ActionsContainer, help: str) -> None:
    """Add `--fps`, frames per second."""
    parser.add_argument("--fps", type=rate, default=24.0, metavar="F", help=help)


def add_caches(parser: argparse._ActionsContainer) -> None:
    """Add `--prim`, `--clip` and `--fps`, which animation of a geometry cache is meant."""
    add_prim(parser)
    clip = "name or number of an animation, where a glTF has several"
    parser.add_argument("--clip", metavar="NAME", help=clip)
    add_fps(parser, "frames per second that glTF and MDD, which have times, are counted by")


def cache_clip(arguments: argparse.Namespace) -> Clip:
    """The clip that the options of `add_caches` choose."""
    return Clip(arguments.prim, arguments.clip, arguments.fps)


def add_several(parser: Arguments, option: str, **named: Any) -> None:
    """Add an option that takes one value or more, and may be repeated."""
    parser.add_argument(option, nargs="+", action="extend", default=[], **named)


def add_json(parser: Arguments) -> None:
    """Add `--json [FILE]`, which writes the figures as JSON."""
    parser.add_argument(
        "--json",
        nargs="?",
        const=STDOUT,
        type=Path,
        metavar="FILE",
        help="write the figures as JSON to FILE, or to stdout in place of the table",
    )


def add_progress(parser: Arguments) -> None:
    """Add `--progress`, the form of progress: for people, or for workers of OpenJD."""
    who = "report to a person, or in the lines that workers of Open Job Description read"
    parser.add_argument("--progress", choices=("person", "openjd"), default="person", help=who)


def add_strict(parser: Arguments) -> None:
    """Add `--strict`, and `--allow CODE` for warnings that it does not refuse."""
    strict = (
        "end with an error where there would be warnings: before anything is made, but for maps "
        "that are mixed, which a bake knows at its end"
    )
    parser.add_argument("--strict", action="store_true", help=strict)
    allow = f"a warning that --strict does not refuse, repeated for several: {', '.join(CODES)}"
    parser.add_argument(
        "--allow", action="append", default=[], choices=CODES, metavar="CODE", help=allow
    )


def with_warnings(
    run: Callable[[argparse.Namespace, RunWarnings], None],
) -> Callable[[argparse.Namespace], None]:
    """A command with the options of `add_strict`: `run` with its warnings, which are counted at its
    end."""

    @wraps(run)
    def whole(arguments: argparse.Namespace) -> None:
        # Imported here, so that --help does not wait for what it imports.
        from rhytid.baking.run_warnings import RunWarnings

        with RunWarnings(arguments.command, arguments.strict, arguments.allow) as warnings:
            run(arguments, warnings)

    return whole


def add_force(parser: Arguments) -> None:
    """Add `--force`, which takes the graph of another mesh."""
    force = "take a graph that was made for another mesh"
    parser.add_argument("--force", action="store_true", help=force)


def add_stiffness(parser: Arguments) -> None:
    """Add `--stiffness FILE ...`."""
    stiffness = "grey PNG or EXR by UDIM, or ANY.<UDIM>.png for all: white moves, black is rigid"
    add_several(parser, "--stiffness", type=map_file, metavar="FILE", help=stiffness)


def add_query(parser: Arguments) -> None:
    """Add `--stretch` and `--sampling`, as in the query of a tile."""
    stretch = "how stretch is measured"
    parser.add_argument("--stretch", choices=STRETCH_MODELS, default="tensor", help=stretch)
    sampling = "where stretch is taken: of whole triangles, or interpolated"
    parser.add_argument("--sampling", choices=SAMPLINGS, default="nearest", help=sampling)


def add_profiles(parser: Arguments) -> None:
    """Add `--profile NAME ...`, and `--half` as a short form."""
    kinds = f"kinds of files to write, one or several: {', '.join(PROFILE_NAMES)} (default: float)"
    add_several(parser, "--profile", choices=PROFILE_NAMES, metavar="NAME", help=kinds)
    parser.add_argument("--half", action="store_true", help="the same as --profile half")
    how = (
        "of float and half: zip, zips and piz are read by all programs, zstd by those with OpenEXR "
        "3.5 alone; dwaa is lossy"
    )
    parser.add_argument("--compression", choices=COMPRESSIONS, default=COMPRESSIONS[0], help=how)


def add_shine(parser: Arguments) -> None:
    """Add `--level L` and `--base-roughness R`."""
    which = (
        "level of slopes, roughness, anisotropy and normals: 1 has half as many texels per side as "
        f"the displacement (default: {USUAL.of_moments}; of normals 0)"
    )
    parser.add_argument("--level", type=int, choices=range(15), metavar="L", help=which)
    base = (
        "roughness of skin without relief, of the profiles roughness and anisotropy, 0 to 1 "
        f"(default: {USUAL.roughness})"
    )
    parser.add_argument(
        "--base-roughness", type=share, default=USUAL.roughness, metavar="R", help=base
    )
