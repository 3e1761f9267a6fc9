"""Reading a neutral mesh, whatever its format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.domain.notices import Notice
from rhytid.domain.warnings import InputWarning
from rhytid.errors import MeshError
from rhytid.formats.frame_set import FrameSet
from rhytid.formats.gltf import read_glb_shapes, read_gltf_shapes
from rhytid.formats.npz import read_npz
from rhytid.formats.obj import read_obj
from rhytid.formats.ply import read_ply


@dataclass(frozen=True, eq=False)
class MeshFile:
    """The contents of a mesh file.

    mesh: the neutral mesh.  frames: (N, V, 3) of a .npz that has them.  shapes: of a .npz, or the
    morph targets of a glTF.  animation: returns the frames of a geometry cache, which are read one
    by one.  unit: of length, where the file names one.  notes: remarks on the file for the user.
    notices: of what in it is not read.  unused: warnings of what may be meant to be.
    """

    mesh: Mesh
    frames: NDArray[np.float32] | None = None
    shapes: Expressions | None = None
    animation: Callable[[], FrameSet] | None = None
    unit: str | None = None
    notes: tuple[str, ...] = ()
    notices: tuple[Notice, ...] = ()
    unused: tuple[InputWarning, ...] = ()

    @property
    def frame_set(self) -> FrameSet | None:
        """The frames of the file; None where it has none."""
        if self.frames is not None:
            return FrameSet.of(self.frames)
        return None if self.animation is None else self.animation()

    @property
    def expressions(self) -> Expressions | None:
        """The shapes; where there are none, the frames as expressions without names; None where the
        file has neither."""
        if self.shapes is not None:
            return self.shapes
        if self.frames is not None:
            return Expressions.checked(self.frames, len(self.mesh.positions))
        frames = self.frame_set
        return None if frames is None else frames.expressions(len(self.mesh.positions))


_READERS: dict[str, Callable[[bytes], Mesh]] = {".obj": read_obj, ".ply": read_ply}
_WITH_SHAPES: dict[str, Callable[[bytes], tuple[Mesh, Expressions | None]]] = {
    ".gltf": read_gltf_shapes,
    ".glb": read_glb_shapes,
}
MESH_EXTENSIONS = (*_READERS, *_WITH_SHAPES, ".npz")
# Read from the file itself alone, by commands: a layer may name other files.
USD_EXTENSIONS = (".usd", ".usda", ".usdc", ".usdz")


def read_mesh(data: bytes, name: str) -> MeshFile:
    """The mesh in the bytes of a file called `name`, whose extension says how to read it.

    The vertex order of the file is kept: it is the order in which frames send their positions.
    Nothing that the file points to is opened. Raises MeshError naming the element that cannot be
    used, FrameError over frames and shapes, LimitError over an array that is too large.
    """
    extension = PurePath(name).suffix.lower()
    if extension == ".npz":
        found = read_npz(data)
        notices, unused = found.notices, found.unused
        return MeshFile(found.mesh, found.frames, found.shapes, notices=notices, unused=unused)
    if extension in _WITH_SHAPES:
        mesh, shapes = _WITH_SHAPES[extension](data)
        return MeshFile(mesh, shapes=shapes)
    if extension not in _READERS:
        known = ", ".join(MESH_EXTENSIONS)
        way = "; `rhytid convert` makes .npz of USD" if extension in USD_EXTENSIONS else ""
        raise MeshError(f"mesh file with extension {extension!r}: must be one of {known}{way}")
    return MeshFile(_READERS[extension](data))
