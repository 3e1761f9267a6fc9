"""What the commands' options have in common."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.domain.expressions import LINES
from rhytid.domain.lengths import SKIN
from rhytid.domain.units import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.domain.warnings import CODES
from rhytid.engine.messages import SAMPLINGS, STRETCH_MODELS
from rhytid.formats.frame_set import Clip
from rhytid.textures.names import PROFILE_NAMES

if TYPE_CHECKING:
    from rhytid.formats.meshes import MeshFile

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", re.ASCII)
STDOUT = Path("-")
MAX_PORT = 65535
MOST_FPS = 10_000
# Settings of `graph` of which each determines the other.
DENSITY = ("spacing", "wrinkles")

# What the commands read.
MESH_FILES = "OBJ, PLY, glTF, GLB, npz or USD"
FRAME_FILES = "npy, OBJ, npz with 'frames', USD, animated glTF or GLB, MDD or PC2"

Commands = Any  # argparse._SubParsersAction has no public name


def new_command(
    commands: Commands, name: str, summary: str, example: str, *parents: argparse.ArgumentParser
) -> argparse.ArgumentParser:
    """A parser for one command, with its help, an example, and the options of its parents."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=summary,
        epilog=f"example: {example}",
        # Else --set would be --settings where there is no --set.
        allow_abbrev=False,
        formatter_class=HelpFormatter,
        parents=parents,
    )
    voice = parser.add_mutually_exclusive_group()
    quiet = "say nothing but results, warnings and errors"
    voice.add_argument("-q", "--quiet", action="store_true", help=quiet)
    verbose = "also say which step begins, which file is written, and where an error came from"
    voice.add_argument("-v", "--verbose", action="store_true", help=verbose)
    return parser


class HelpFormatter(argparse.HelpFormatter):
    """Ends the help of every option that takes a value with its default."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        optional = action.option_strings and not action.required and action.nargs != 0
        if not action.help or not optional or "(default: " in action.help:
            return action.help
        known = action.default not in (None, []) and action.default is not argparse.SUPPRESS
        return f"{action.help} (default: {'%(default)s' if known else 'none'})"


def add_json(parser: argparse.ArgumentParser) -> None:
    """`--json [FILE]`: figures for machines."""
    parser.add_argument(
        "--json",
        nargs="?",
        const=STDOUT,
        type=Path,
        metavar="FILE",
        help="write the figures as JSON to FILE, or to stdout in place of the table",
    )


def add_progress(parser: argparse.ArgumentParser) -> None:
    """`--progress`: whom progress is reported to."""
    who = "report to a person, or in the lines that workers of Open Job Description read"
    parser.add_argument("--progress", choices=("person", "openjd"), default="person", help=who)


def add_several(parser: argparse._ActionsContainer, option: str, **named: Any) -> None:
    """An option of one value or more, that may be given more than once."""
    parser.add_argument(option, nargs="+", action="extend", default=[], **named)


def add_density(parser: argparse.ArgumentParser) -> argparse._ActionsContainer:
    """`--spacing S` or `--wrinkles N`, of which one excludes the other, and what they are in."""
    group = parser.add_mutually_exclusive_group()
    usual = f"distance between pores, mesh units (default: {SKIN.spacing:g} mm through the unit)"
    group.add_argument("--spacing", type=float, metavar="S", help=usual)
    count = "how many wrinkles to grow (default: as many as that spacing makes)"
    group.add_argument("--wrinkles", type=int, metavar="N", help=count)
    return group


def density(arguments: argparse.Namespace) -> dict[str, Any]:
    """The setting of `graph` that says how dense pores are: none where nothing is given."""
    given = {name: getattr(arguments, name) for name in DENSITY}
    return {name: value for name, value in given.items() if value is not None}


def add_lines(parser: argparse.ArgumentParser) -> None:
    """`--lines` and `--shapes`: what the lines of the skin grow by."""
    lines = "along the folds of expressions, or level (default: auto, by expressions if any)"
    parser.add_argument("--lines", choices=LINES, help=lines)
    shapes = (
        "expressions: npz with 'shapes' and 'names' or with 'frames', npy, a geometry cache, or a "
        "folder of OBJ (default: those of the mesh file)"
    )
    parser.add_argument("--shapes", type=_existing, metavar="FILE|DIR", help=shapes)


def _existing(text: str) -> Path:
    if not Path(text).exists():
        raise argparse.ArgumentTypeError(f"no such file or folder: {text}")
    return Path(text)


def add_unit(
    parser: argparse.ArgumentParser,
    what: str,
    default: str = "that of a graph or of a USD file which names one, else cm",
) -> None:
    """`--unit U`, the length unit of `what`."""
    known = ", ".join(name for name in MILLIMETRES if name.isascii())
    unit = f"length unit of {what}: {known} (default: {default})"
    parser.add_argument("--unit", type=_unit, metavar="U", help=unit)


def add_prim(parser: argparse.ArgumentParser) -> None:
    """`--prim`: which mesh of a USD stage is meant."""
    prim = "path or name of a mesh, where a USD stage has several"
    parser.add_argument("--prim", metavar="PATH", help=prim)


def prim_clip(prim: str | None) -> Clip:
    """What `--prim` says, for a command that takes no animation."""
    return Clip(prim=prim)


def add_fps(parser: argparse.ArgumentParser, help: str) -> None:
    """`--fps`: frames per second."""
    parser.add_argument("--fps", type=_rate, default=24.0, metavar="F", help=help)


def length_unit(arguments: argparse.Namespace, file: MeshFile) -> str:
    """The unit that `--unit` names, else that of the mesh file, else the usual one."""
    return arguments.unit or file.unit or USUAL_UNIT


def add_caches(parser: argparse.ArgumentParser) -> None:
    """`--prim`, `--clip` and `--fps`: which animation of a geometry cache is meant."""
    add_prim(parser)
    clip = "name or number of an animation, where a glTF has several"
    parser.add_argument("--clip", metavar="NAME", help=clip)
    add_fps(parser, "frames per second that glTF and MDD, which have times, are counted by")


def cache_clip(arguments: argparse.Namespace) -> Clip:
    """The clip that these options choose."""
    return Clip(arguments.prim, arguments.clip, arguments.fps)


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0.0 < rate <= MOST_FPS:
        raise argparse.ArgumentTypeError(f"{text!r}: a number above 0, at most {MOST_FPS}")
    return rate


def add_force(parser: argparse.ArgumentParser) -> None:
    """`--force`."""
    force = "take a graph that was made for another mesh"
    parser.add_argument("--force", action="store_true", help=force)


def _unit(text: str) -> str:
    if millimetres(text) is None:
        raise argparse.ArgumentTypeError(f"{text!r}: one of {', '.join(MILLIMETRES)}")
    return text


def add_shared_store(parser: argparse.ArgumentParser) -> None:
    """`--shared-store PLACE`."""
    told = (
        "where assets are that several machines share: a folder that all mount, or "
        "s3://BUCKET/PREFIX with the extra s3 (default: of RHYTID_SHARED_STORE, else none)"
    )
    parser.add_argument("--shared-store", metavar="PLACE", help=told)


def add_device(parser: argparse.ArgumentParser, more: str = "") -> None:
    """`--device D`."""
    device = f"number or part of the name of a device{more} (default: RHYTID_DEVICE, or chosen)"
    parser.add_argument("--device", metavar="D", help=device)


def add_stiffness(parser: argparse.ArgumentParser) -> None:
    """`--stiffness FILE ...`."""
    stiffness = "grey PNG or EXR, one per UDIM, named ANY.<UDIM>.png: white moves, black is rigid"
    add_several(parser, "--stiffness", type=readable, metavar="FILE", help=stiffness)


def add_profiles(parser: argparse.ArgumentParser) -> None:
    """`--profile NAME ...`, and `--half` for one of them."""
    kinds = f"kinds of files to write, one or several: {', '.join(PROFILE_NAMES)} (default: float)"
    add_several(parser, "--profile", choices=PROFILE_NAMES, metavar="NAME", help=kinds)
    parser.add_argument("--half", action="store_true", help="the same as --profile half")


def add_strict(parser: argparse.ArgumentParser) -> None:
    """`--strict`, and `--allow CODE` for what it shall not refuse."""
    strict = "end with an error, before anything is made, where there would be warnings"
    parser.add_argument("--strict", action="store_true", help=strict)
    allow = f"a warning that --strict does not refuse, repeated for several: {', '.join(CODES)}"
    parser.add_argument(
        "--allow", action="append", default=[], choices=CODES, metavar="CODE", help=allow
    )


def add_query(parser: argparse.ArgumentParser) -> None:
    """`--stretch` and `--sampling`, as a tile's query has them."""
    stretch = "how stretch is measured"
    parser.add_argument("--stretch", choices=STRETCH_MODELS, default="tensor", help=stretch)
    sampling = "where stretch is taken: of whole triangles, or interpolated"
    parser.add_argument("--sampling", choices=SAMPLINGS, default="nearest", help=sampling)


def readable(text: str) -> Path:
    """A file that is there; as an argparse type."""
    path = Path(text)
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"no such file: {text}")
    return path


def port_number(text: str) -> int:
    """A TCP port, or 0; as an argparse type."""
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_PORT):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 0 to {MAX_PORT}")
    return int(text)


def positive(text: str) -> int:
    """A whole number from 1; as an argparse type."""
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 1")
    return int(text)


def is_file_name(text: str) -> bool:
    """Whether a text may be a part of the names of written files, which dots divide."""
    return _NAME.fullmatch(text) is not None


def base_name(text: str) -> str:
    """The first part of the names of written files; as an argparse type."""
    if not is_file_name(text):
        rule = "a letter or digit, then up to 63 letters, digits, '_' or '-'"
        raise argparse.ArgumentTypeError(f"{text!r}: use {rule}")
    return text
