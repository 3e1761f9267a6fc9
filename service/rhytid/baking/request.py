"""The request of a bake, and the summary of its result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.baking.frame_names import FrameRange
from rhytid.domain.scan import ScanSettings
from rhytid.engine.messages import MapQuery
from rhytid.exports.textures import USUAL, Shine
from rhytid.formats.frame_set import Clip
from rhytid.support.settings import ServiceSettings

if TYPE_CHECKING:
    from rhytid.exports.textures.profiles import Profile

# In place of the address of a Dask scheduler: processes on this machine.
LOCAL = "local"
# Seconds of the profile `blood`.
USUAL_SECONDS = 0.15
# Frames per task of a job of a render farm.
CHUNK = 10


@dataclass(frozen=True)
class Lag:
    """How late blood follows.  seconds: the time constant; 0 for none.  fps: frames a second."""

    seconds: float = USUAL_SECONDS
    fps: float = 24.0

    @property
    def frames(self) -> float:
        """The time constant in frames."""
        return self.seconds * self.fps

    def kept(self, steps: float) -> float:
        """The share of x - y that is left after some frames."""
        return math.exp(-steps / self.frames) if self.frames > 0.0 else 0.0


@dataclass(frozen=True)
class SkinRequest:
    """The skin of an asset that is built, and the files that it is made from.

    settings: of the asset, as in JSON, not checked yet.  graph: file of a wrinkle graph; None grows
    one.  stiffness: files of stiffness maps.  maps: files of control maps, by the name of the
    control.  shapes: file or folder of expressions; None for those of the mesh file.  force:
    whether a graph of another mesh is used.  residual: files of the residual of a traced graph.
    scan: files of displacement to be traced in place of `graph`, as `scan_settings` say, but where
    images `scan_masks` are black.
    """

    settings: Mapping[str, Any]
    graph: Path | None = None
    stiffness: Sequence[Path] = ()
    maps: Mapping[str, Sequence[Path]] = field(default_factory=dict)
    shapes: Path | None = None
    force: bool = False
    residual: Sequence[Path] = ()
    scan: Sequence[Path] = ()
    scan_settings: ScanSettings = field(default_factory=ScanSettings)
    scan_masks: Sequence[Path] = ()


@dataclass(frozen=True)
class BakeRequest:
    """A bake: the mesh and its frames, the skin, the maps, and who draws them.

    mesh: file of the neutral.  clip: which mesh and animation of a file are meant.  frames: files
    of frames; without any, the mesh file has them.  frames_list: file of a list of frames, in place
    of `frames`.  frames_folder: folder that names in the list are relative to; None for that of the
    list.  part: frames to bake; None for all.

    skin: the asset to build; None where the built asset with the id `asset` is used.  resolution:
    texels per side of that one; None for its own.

    out: folder of the maps.  name: first part of the names of files; None for that of the mesh.
    profiles: kinds of maps.  compression: of those that have a choice.  query: how they are drawn.
    geometry: format of displaced surfaces, `glb` or `ply`; None for no surfaces.  subdivide: how
    often their triangles are cut in four.

    service: settings of the engine.  store: folder of the assets; None for one that lasts as long
    as the bake.  openjd: folder of a job bundle, which is written in place of maps.  dask: address
    of a Dask scheduler whose workers bake, or LOCAL.  dask_workers: processes of LOCAL; None for as
    many as fit.  chunk: frames per task of `openjd` or `dask`; None for the usual number.

    shine: how the profiles slopes, roughness and anisotropy are made.  blood_seconds: time constant
    of the profile `blood`, at `clip.fps` frames a second.

    strict, allow: which warnings are errors on other machines.
    """

    mesh: Path
    out: Path
    profiles: tuple[Profile, ...]
    query: MapQuery
    service: ServiceSettings
    compression: str = "zip"
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
    blood_seconds: float = USUAL_SECONDS
    shine: Shine = USUAL
    strict: bool = False
    allow: Sequence[str] = ()

    @property
    def lag(self) -> Lag:
        """How late the profile `blood` follows."""
        return Lag(self.blood_seconds, self.clip.fps)


@dataclass(frozen=True)
class BakeSummary:
    """The result of a bake.  figures: for JSON.  text: for people."""

    figures: dict[str, Any]
    text: str
