"""`rhytid look`: baked maps as a USD layer and a MaterialX document."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.cli.options import add_fps, add_json, add_unit, base_name, readable
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.wording import plural
from rhytid.errors import InputError
from rhytid.support.console import note, report, table

if TYPE_CHECKING:
    from rhytid.domain.mesh import Mesh
    from rhytid.exports.look import Look

SUMMARY = SUMMARIES["look"]
DETAILS = """
DIR is a folder of NAME.<UDIM>.<FRAME>.exr, as bake writes it; NAME.look.usda and NAME.mtlx are
written beside the maps. The layer goes among the sublayers of a scene; at every frame it has the
map of that number."""
# Names of a bake have no dots: other files of it do, before the UDIM.
_FILE = re.compile(r"([^.]+)\.([0-9]{4})\.([^.]+)\.exr", re.ASCII)
# So many frames are named one by one in an error.
_FEW = 6
_PRIM = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+", re.ASCII)


def add_command(commands: Commands) -> None:
    """Add `look` to the parser."""
    example = "rhytid look maps --bind /root/face/mesh"
    parser = new_command(commands, "look", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="folder of the maps")
    named = "first part of the maps' names, where DIR has several (default: the only one)"
    add("--name", type=base_name, metavar="NAME", help=named)
    frame = "the look of one frame alone, by its number or name as files have it (default: all)"
    add("--frame", metavar="FRAME", help=frame)
    add_unit(parser, "the scene", "that of the maps")
    add_fps(parser, "frames per second of the scene")
    add("--uv", type=_word, default="st", metavar="PRIMVAR", help="texture coordinates of the mesh")
    bind = "bind the material to this mesh of the scene, and keep its UV linear"
    add("--bind", type=_prim, metavar="PATH", help=bind)
    material = "give the displacement to this material of the scene, in place of one of its own"
    add("--material", type=_prim, metavar="PATH", help=material)
    told = "connect NAME.roughness.*.png and NAME.anisotropy.*.png of bake, too"
    add("--shine", action="store_true", help=told)
    told = (
        "mesh of the one frame: write NAME.<FRAME>.glb of it, with NAME.roughness, .anisotropy and "
        ".normal-gl of its maps as a material"
    )
    add("--gltf", type=readable, metavar="MESH", help=told)
    add_json(parser)
    parser.set_defaults(run=run, usage_error=parser.refuse)


def run(arguments: argparse.Namespace) -> None:
    """Write both files for the maps of a folder, and report their figures."""
    from rhytid.exports.look import materialx_look
    from rhytid.exports.usda import usd_look
    from rhytid.support.atomic_files import atomic_write, write_file

    look = found(arguments)
    texts = {"look.usda": usd_look(look).encode(), "mtlx": materialx_look(look)}
    if arguments.gltf is not None:
        texts[f"{look.frames[0]}.glb"] = _gltf(arguments, look)
    _note_gaps(look.frames)
    files = [arguments.folder / f"{look.name}.{end}" for end in texts]
    for file, text in zip(files, texts.values(), strict=True):
        with atomic_write(file) as aside:
            write_file(aside, text)
    figures = {
        "usd": str(files[0]),
        "materialx": str(files[1]),
        "udims": list(look.udims),
        "frames": len(look.frames),
        "first": look.frames[0],
        "last": look.frames[-1],
        "unit": look.unit,
        "scale": look.scale,
    }
    if arguments.gltf is not None:
        figures["gltf"] = str(files[2])
    rows = figures | {"udims": ", ".join(map(str, look.udims))}
    report(figures, table(("figure", "value"), rows.items()), arguments.json)


def _note_gaps(frames: Sequence[str]) -> None:
    """Print which frames between the first and the last have no map, and what is shown there."""
    if len(frames) < 2 or not all(frame.isdecimal() for frame in frames):
        return
    numbers = [int(frame) for frame in frames]
    gaps = sorted(set(range(numbers[0], numbers[-1])) - set(numbers))
    if gaps:
        listed = ", ".join(map(str, gaps[:5])) + (" and more" if len(gaps) > 5 else "")
        note(
            f"rhytid look: no maps of {plural(len(gaps), 'frame')} in between: {listed}. There USD "
            "shows the map before, MaterialX finds no file"
        )


def found(arguments: argparse.Namespace) -> Look:
    """The look of the maps in a folder. Raises InputError naming what is missing."""
    from rhytid.exports.look import Look
    from rhytid.formats.exr import read_attributes

    folder: Path = arguments.folder
    if arguments.shine and arguments.material is not None:
        arguments.usage_error("--shine is of a material of its own, --material names one: use one")
    name, maps = _maps(folder, arguments.name)
    frames = sorted({frame for _, frame in maps}, key=_order)
    if arguments.frame is not None:
        if arguments.frame not in frames:
            known = ", ".join(frames) if len(frames) < _FEW else f"{frames[0]} to {frames[-1]}"
            raise InputError(f"{folder} has no maps of frame {arguments.frame}: of {known} alone")
        frames = [arguments.frame]
    udims = sorted({udim for udim, _ in maps})
    for frame in frames:
        for udim in udims:
            if (udim, frame) not in maps:
                raise InputError(f"{name}.{udim}.{frame}.exr is missing in {folder}")
    for file in _shine_files(name, udims, frames) if arguments.shine else ():
        if not (folder / file).is_file():
            raise InputError(f"{file} is missing in {folder}: bake it, or leave out --shine")
    unit = read_attributes(folder / f"{name}.{udims[0]}.{frames[0]}.exr").get("unit", "")
    return Look(
        name,
        tuple(udims),
        tuple(frames),
        str(unit),
        arguments.unit or str(unit),
        arguments.uv,
        arguments.fps,
        arguments.bind,
        arguments.material,
        arguments.shine,
    )


def _gltf(arguments: argparse.Namespace, look: Look) -> bytes:
    """A GLB of the mesh with the maps of the look's frame. Raises InputError."""
    from rhytid.baking.input_files import mesh_file
    from rhytid.exports.look_gltf import ShineMaps, write_shining_glb

    if len(look.frames) > 1:
        raise InputError(f"--gltf is of one frame, DIR has {len(look.frames)}: choose with --frame")
    maps = {}
    for udim in look.udims:
        names = [
            f"{look.name}.{map}.{udim}.{look.frames[0]}.png"
            for map in ("roughness", "anisotropy", "normal-gl")
        ]
        maps[udim] = ShineMaps(*_of_one_level(arguments.folder, names))
    mesh = mesh_file(arguments.gltf).mesh
    _check_mesh(mesh, arguments.gltf, arguments.folder / f"{look.name}.roughness.json")
    return write_shining_glb(mesh, maps)


def _check_mesh(mesh: Mesh, file: Path, facts: Path) -> None:
    """Raise InputError where maps are of another mesh, by the file that `bake` leaves beside them;
    older ones have none, or say nothing of the mesh."""
    from rhytid.baking.output import mesh_facts

    told, own = _told(facts) if facts.is_file() else {}, mesh_facts(mesh)
    theirs = {name: told.get(name) for name in own}
    if own == theirs or None in theirs.values():
        return
    counts = [f"{of['vertices']} vertices and {of['triangles']} triangles" for of in (own, theirs)]
    if counts[0] == counts[1]:
        why = f"{file} has {counts[0]}, as the mesh of {facts}, but joins them otherwise"
    else:
        why = f"{file} has {counts[0]}, the mesh of {facts} has {counts[1]}"
    raise InputError(f"{why}: give a frame of that mesh")


def _told(facts: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(facts.read_bytes()))
    except (ValueError, TypeError) as error:
        raise InputError(f"{facts} is damaged: bake again, or remove it") from error


def _of_one_level(folder: Path, names: Sequence[str]) -> list[bytes]:
    """The files; raises InputError where one is missing or their levels differ."""
    from rhytid.formats.png import read_texts

    for name in names:
        if not (folder / name).is_file():
            raise InputError(
                f"{name} is missing in {folder}: bake with --level and "
                "--profile roughness anisotropy normal-gl"
            )
    files = [(folder / name).read_bytes() for name in names]
    levels = [read_texts(*file).get("level", "0") for file in zip(files, names, strict=True)]
    if len(set(levels)) > 1:
        told = ", ".join(f"{name} of {level}" for name, level in zip(names, levels, strict=True))
        raise InputError(f"maps of one level are needed, there are {told}: bake with --level")
    return files


def _shine_files(name: str, udims: Sequence[int], frames: Sequence[str]) -> list[str]:
    return [
        f"{name}.{map}.{udim}.{frame}.png"
        for map in ("roughness", "anisotropy")
        for udim in udims
        for frame in frames
    ]


def _maps(folder: Path, name: str | None) -> tuple[str, set[tuple[int, str]]]:
    """The first part of the names of the maps in a folder, and their UDIMs and frames."""
    if not folder.is_dir():
        raise InputError(f"no such folder: {folder}")
    files = [match for path in folder.glob("*.exr") if (match := _FILE.fullmatch(path.name))]
    names = sorted({match[1] for match in files})
    if not names or (name is not None and name not in names):
        wanted = f"{name or 'NAME'}.<UDIM>.<FRAME>.exr"
        raise InputError(
            f"{folder} has no files named {wanted}, which bake writes for --profile float or half"
        )
    if name is None and len(names) > 1:
        raise InputError(f"{folder} has maps of {', '.join(names)}: --name chooses")
    name = name or names[0]
    return name, {(int(match[2]), match[3]) for match in files if match[1] == name}


def _order(frame: str) -> tuple[int, str]:
    return (int(frame) if frame.isdecimal() else 0, frame)


def _word(text: str) -> str:
    if _PRIM.fullmatch(f"/{text}") is None or "/" in text:
        raise argparse.ArgumentTypeError(f"{text!r}: letters, digits and '_', no digit first")
    return text


def _prim(text: str) -> str:
    if _PRIM.fullmatch(text) is None:
        raise argparse.ArgumentTypeError(f"{text!r}: a path such as /root/face")
    return text
