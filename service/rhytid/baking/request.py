"""What a bake is asked for, and what it comes to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.baking.frame_names import FrameRange
from rhytid.engine.messages import MapQuery
from rhytid.formats.frame_set import Clip
from rhytid.settings import ServiceSettings

if TYPE_CHECKING:
    from rhytid.textures.profiles import Profile

# In place of the address of a Dask scheduler: processes on this machine.
LOCAL = "local"
# Frames per task of a job of a render farm.
CHUNK = 10


@dataclass(frozen=True)
class SkinRequest:
    """The skin of an asset that is built, and the files that it is made from.

    settings: of the asset, as JSON has them; not checked yet.  graph: the file of a wrinkle graph;
    None grows one.  stiffness: files of stiffness maps.  maps: files of control maps, by the name
    of what they control.  shapes: file or folder of expressions; None takes those of the mesh file.
    force: whether a graph of another mesh is taken.
    """

    settings: Mapping[str, Any]
    graph: Path | None = None
    stiffness: Sequence[Path] = ()
    maps: Mapping[str, Sequence[Path]] = field(default_factory=dict)
    shapes: Path | None = None
    force: bool = False


@dataclass(frozen=True)
class BakeRequest:
    """A bake: an animated mesh, its skin, the maps that are drawn, and where.

    mesh: file of the neutral.  clip: which mesh and animation of a file are meant.  frames: files
    of frames.  frames_list: a text file that lists frames in place of `frames`.  frames_folder: the
    folder that names in it are relative to; None is its own.  part: the frames to bake; None bakes
    all.

    skin: of the asset to build; None where the asset with the id `asset` is used, at `resolution`
    texels per side; None is its own resolution.

    out: folder of the maps.  name: first part of the names of files; None is that of the mesh.
    query: how maps are drawn.  geometry: format of displaced surfaces, None for none, whose
    triangles are cut in four `subdivide` times.

    service: settings of the engine.  store: folder of the assets; None for one that lasts as long
    as the bake.  openjd: folder of a job bundle that is written in place of maps.  dask: address of
    a Dask scheduler whose workers bake, or LOCAL; `dask_workers` is the number of processes then.
    chunk: frames per task of either; None is usual.

    strict, allow: which warnings are errors, for workers.
    """

    mesh: Path
    out: Path
    profiles: tuple[Profile, ...]
    query: MapQuery
    service: ServiceSettings
    skin: SkinRequest | None = None
    asset: str | None = None
    resolution: int | None = None
    store: Path | None = None
    clip: Clip = field(default_factory=Clip)
    frames: Sequence[Path] = ()
    frames_list: Path | None = None
    frames_folder: Path | None = None
    part: FrameRange | None = None
    name: str | None = None
    geometry: str | None = None
    subdivide: int = 2
    openjd: Path | None = None
    dask: str | None = None
    dask_workers: int | None = None
    chunk: int | None = None
    strict: bool = False
    allow: Sequence[str] = ()


@dataclass(frozen=True)
class BakeSummary:
    """What a bake came to.  figures: for programs, as JSON has them.  text: for people."""

    figures: dict[str, Any]
    text: str
