"""A bake as plain data, for processes on other machines."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rhytid.cli.frame_files import FramePlace
from rhytid.cli.frames_list import frame_sources
from rhytid.cli.mesh_options import cache_clip
from rhytid.domain.mesh import Mesh
from rhytid.engine.messages import MapQuery
from rhytid.errors import InputError
from rhytid.formats.frame_set import Clip
from rhytid.support.build_identity import check_drawing, drawing_version

if TYPE_CHECKING:
    from rhytid.cli.bake_inputs import BakeInputs
    from rhytid.cli.baking import Baker


@dataclass(frozen=True)
class SharedFile:
    """A file that is read on several machines, at the same path."""

    path: str
    nbytes: int

    @classmethod
    def of(cls, path: Path) -> SharedFile:
        """The file at a path."""
        place = path.resolve()
        return cls(str(place), place.stat().st_size)

    def check(self) -> Path:
        """Its path; raises InputError naming it where it is not here, or has another size."""
        path = Path(self.path)
        if not path.is_file():
            raise InputError(f"no such file: {path}; paths of a cluster are the same everywhere")
        if path.stat().st_size != self.nbytes:
            raise InputError(f"{path} has {path.stat().st_size} bytes, not {self.nbytes}")
        return path


@dataclass(frozen=True)
class WorkerJob:
    """What a worker has to know to bake some of the frames.

    mesh_digest: of the arrays of the mesh.  frames: all of them, whose files have absolute paths.
    files: these, where a frame is baked.  snapshot: of the built asset, whose id is `asset`.  out:
    the folder of the maps.  geometry: the format of displaced surfaces, if there are any.  drawing:
    the `drawing_version` of the machine that made the job.
    """

    mesh: SharedFile
    mesh_digest: str
    frames: tuple[FramePlace, ...]
    files: tuple[SharedFile, ...]
    clip: Clip
    snapshot: SharedFile
    asset: str
    out: str
    name: str
    profiles: tuple[str, ...]
    geometry: str | None
    subdivide: int
    query: MapQuery
    strict: bool
    allow: tuple[str, ...]
    drawing: str

    @classmethod
    def of(
        cls,
        arguments: argparse.Namespace,
        given: BakeInputs,
        baker: Baker,
        snapshot: Path,
        baked: Sequence[FramePlace],
    ) -> WorkerJob:
        """The job of a bake.  snapshot: of its asset.  baked: the frames that are baked."""
        return cls(
            mesh=SharedFile.of(arguments.mesh),
            mesh_digest=mesh_digest(baker.mesh),
            frames=tuple(map(_resolved, baker.frames.places)),
            files=tuple(map(SharedFile.of, frame_sources(baked))),
            clip=cache_clip(arguments),
            snapshot=SharedFile.of(snapshot),
            asset=baker.asset.id,
            out=str(arguments.out.resolve()),
            name=given.name,
            profiles=tuple(profile.name for profile in given.profiles),
            geometry=arguments.geometry,
            subdivide=arguments.subdivide,
            query=baker.query,
            strict=arguments.strict,
            allow=tuple(arguments.allow),
            drawing=drawing_version(),
        )

    def check(self) -> None:
        """Raise InputError where mesh or snapshot are not here, or this rhytid draws otherwise."""
        check_drawing(self.drawing)
        self.mesh.check()
        self.snapshot.check()

    def check_mesh(self, mesh: Mesh) -> None:
        """Raise InputError where the file of the mesh holds another than the job was made of."""
        if mesh_digest(mesh) != self.mesh_digest:
            raise InputError(
                f"{self.mesh.path} holds another mesh than on the machine that began the bake"
            )

    def check_frames(self, places: Iterable[FramePlace]) -> None:
        """Raise InputError where the file of one of these frames is not here, or is another."""
        paths = set(map(str, frame_sources([*places])))
        for file in self.files:
            if file.path in paths:
                file.check()


def mesh_digest(mesh: Mesh) -> str:
    """SHA-256 of the arrays of a mesh: its file may hold the frames of a film, too."""
    digest = hashlib.sha256()
    for array in (mesh.positions, mesh.faces, mesh.uv, mesh.face_uv, mesh.centre):
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _resolved(place: FramePlace) -> FramePlace:
    """The same frame by a path that does not depend on where a process runs."""
    return place if place.file is None else replace(place, file=place.file.resolve())
