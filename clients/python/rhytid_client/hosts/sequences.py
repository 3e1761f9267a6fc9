"""Maps of an animation as files: their names, those in a folder, and copies under other names."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from uuid import uuid4

from rhytid_client.hosts.exr_header import float_attribute, int_attribute, text_attribute
from rhytid_client.hosts.trouble import Trouble

# Names of files, with the tokens that stand for numbers, and least digits of a frame.
Style = tuple[str, int]
# As `rhytid bake` writes them: Blender, Houdini, and Maya where there is one UDIM.
STANDARD: Style = ("{name}.<UDIM>.<FRAME>.exr", 4)
# Arnold for Maya puts frames beside a UDIM token without zeros in front.
UNPADDED: Style = ("{name}.<UDIM>.<FRAME>.exr", 1)
# Unreal takes ".1001" or "_1001" at the end of a name for the UDIM, and frame 1050, too.
UDIM_LAST: Style = ("{name}_f<FRAME>.<UDIM>.exr", 4)
NO_UDIM: Style = ("{name}_f<FRAME>.exr", 4)
_FILE = re.compile(r"([^.]+)\.(1\d{3})\.(\d+)\.exr")
_ONE = (1001,)


@dataclass(frozen=True)
class MapSequence:
    """The maps of one mesh.

    pattern: path with <UDIM> and <FRAME> in place of the numbers.  udims, frames: their numbers,
    ascending.  digits: least ones of a frame.  unit: of length, empty where unknown.  bound: no
    height is farther from 0, in that unit; None where unknown.  triangles: of the mesh; None where
    unknown.
    """

    name: str
    pattern: str
    udims: tuple[int, ...]
    frames: tuple[int, ...]
    digits: int = 4
    unit: str = ""
    bound: float | None = None
    triangles: int | None = None

    @classmethod
    def of(
        cls, folder: Path, name: str, style: Style, udims: Iterable[int], frames: Iterable[int]
    ) -> MapSequence:
        """One in a folder, whose files are called after a style."""
        pattern, digits = style
        path = str(folder / pattern.format(name=name))
        return cls(name, path, tuple(udims), tuple(frames), digits)

    @property
    def tiled(self) -> bool:
        """Whether there is another UDIM than 1001."""
        return self.udims != _ONE

    @property
    def shine(self) -> MapSequence:
        """What `baking` writes beside for shine: NAME.shine.<UDIM>.<FRAME>.png."""
        folder, name = Path(self.pattern).parent, Path(self.pattern).name
        other = name.replace(f"{self.name}.", f"{self.name}.shine.", 1).removesuffix("exr") + "png"
        return replace(self, pattern=str(folder / other))

    def path(self, frame: int) -> str:
        """The path of a frame, with <UDIM> in it."""
        return self.pattern.replace("<FRAME>", f"{frame:0{self.digits}d}")

    def file(self, udim: int, frame: int) -> Path:
        """The file of one map."""
        return Path(self.path(frame).replace("<UDIM>", str(udim)))

    def tokens(self, frame: str, udim: str = "<UDIM>") -> str:
        """The path with the tokens of a host; where there is 1001 alone, it has that number."""
        of_udim = udim if self.tiled else str(_ONE[0])
        return self.pattern.replace("<FRAME>", frame).replace("<UDIM>", of_udim)


def found(folder: Path, name: str = "") -> MapSequence:
    """The sequence that `rhytid bake` left in a folder; raises Trouble where there is none, or
    several and no name."""
    files = [match for path in folder.glob("*.exr") if (match := _FILE.fullmatch(path.name))]
    names = sorted({match[1] for match in files})
    if not names:
        raise Trouble(f"{folder} has no files named NAME.<UDIM>.<FRAME>.exr")
    if not name and len(names) > 1:
        raise Trouble(f"{folder} has maps of {', '.join(names)}: give the name of one")
    files = [match for match in files if match[1] == (name or names[0])]
    if not files:
        raise Trouble(f"{folder} has no maps of {name}; there are {', '.join(names)}")
    return _checked(folder, files)


def _listed(frames: list[int]) -> str:
    if len(frames) == 1:
        return f"frame {frames[0]}"
    more = f" and {len(frames) - 5} more" if len(frames) > 5 else ""
    return f"the frames {', '.join(map(str, frames[:5]))}{more}"


def _checked(folder: Path, files: list[re.Match[str]]) -> MapSequence:
    udims = sorted({int(match[2]) for match in files})
    frames = sorted({int(match[3]) for match in files})
    missing = set(range(frames[0], frames[-1] + 1)) - set(frames)
    if missing:
        raise Trouble(
            f"Maps of {_listed(sorted(missing))} are missing in {folder}: bake them again"
        )
    if len(files) != len(udims) * len(frames):
        raise Trouble(f"Some frames in {folder} have no map of a UDIM: bake them again")
    digits = min(len(match[3]) for match in files)
    for match in files:  # 1 beside 02: no rule makes both names
        if match[3] != f"{int(match[3]):0{digits}d}":
            raise Trouble(f"{match[0]} in {folder} has zeros that other files have not")
    style = (STANDARD[0], digits)
    sequence = MapSequence.of(folder, files[0][1], style, udims, frames)
    unit = text_attribute(folder / files[0][0], "unit") or ""
    bounds = [_bound(folder / match[0]) for match in files]
    known = [bound for bound in bounds if bound is not None]
    bound = max(known) if len(known) == len(bounds) else None
    triangles = int_attribute(folder / files[0][0], "triangles")
    return replace(sequence, unit=unit, bound=bound, triangles=triangles)


def _bound(file: Path) -> float | None:
    least, most = (float_attribute(file, name) for name in ("minimum", "maximum"))
    return None if least is None or most is None else max(-least, most, 0.0)


def copied(maps: MapSequence, folder: Path, style: Style) -> MapSequence:
    """The same maps under the names of another style, copied into a folder that is there."""
    copies = MapSequence.of(folder, maps.name, style, maps.udims, maps.frames)
    for udim in maps.udims:
        for frame in maps.frames:
            _copy(maps.file(udim, frame), copies.file(udim, frame))
    return replace(copies, unit=maps.unit, bound=maps.bound, triangles=maps.triangles)


def _copy(source: Path, target: Path) -> None:
    aside = target.with_name(f".{target.name}.{uuid4().hex}")
    try:
        shutil.copyfile(source, aside)
        aside.replace(target)
    except OSError as exc:
        aside.unlink(missing_ok=True)
        raise Trouble(f"{source} cannot be copied to {target}: {exc}") from exc
