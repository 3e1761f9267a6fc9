"""Reading a neutral mesh, whatever its format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.errors import MeshError
from rhytid.formats.gltf import read_glb, read_gltf
from rhytid.formats.npz import read_npz
from rhytid.formats.obj import read_obj
from rhytid.formats.ply import read_ply


@dataclass(frozen=True, eq=False)
class MeshFile:
    """What a mesh file holds: the neutral mesh, and frames (N, V, 3) if it is a .npz with them."""

    mesh: Mesh
    frames: NDArray[np.float32] | None = None


_READERS: dict[str, Callable[[bytes], Mesh]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".gltf": read_gltf,
    ".glb": read_glb,
}
MESH_EXTENSIONS = (*_READERS, ".npz")


def read_mesh(data: bytes, name: str) -> MeshFile:
    """The mesh in the bytes of a file called `name`, whose extension says how to read it.

    The vertex order of the file is kept: it is the order in which frames send their positions.
    Nothing that the file points to is opened. Raises MeshError naming the element that cannot be
    used, FrameError over the frames of a .npz, LimitError over an array that is too large.
    """
    extension = PurePath(name).suffix.lower()
    if extension == ".npz":
        return MeshFile(*read_npz(data))
    if extension not in _READERS:
        known = ", ".join(MESH_EXTENSIONS)
        raise MeshError(f"mesh file with extension {extension!r}: must be one of {known}")
    return MeshFile(_READERS[extension](data))
