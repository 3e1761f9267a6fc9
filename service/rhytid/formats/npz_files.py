"""Writing a mesh and its animation as the .npz that `read_npz` reads, a frame at a time."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh, add_centre
from rhytid.formats.limits import MAX_FRAME_NUMBERS, check_size
from rhytid.formats.meshes import MeshFile


def write_mesh_npz(
    path: Path, read: MeshFile, frames: Iterable[NDArray[np.float32]], count: int
) -> None:
    """A new file with the mesh, its shapes by name, and `count` frames (V, 3).

    Positions stand where they stood in the file that was read: those that were less a centre are
    doubles. Raises LimitError where there are more frames than are read from one file.
    """
    mesh = read.mesh
    check_size("the frames", mesh.positions.size * count, MAX_FRAME_NUMBERS)
    with path.open("xb") as file:
        with zipfile.ZipFile(file, "w") as archive:
            for name, values in _arrays(read).items():
                with _member(archive, name) as member:
                    np.lib.format.write_array(member, values, allow_pickle=False)
            if count:
                with _member(archive, "frames") as member:
                    _write_frames(member, mesh, frames, count)
        file.flush()
        os.fsync(file.fileno())


def _arrays(read: MeshFile) -> Mapping[str, NDArray[Any]]:
    mesh, shapes = read.mesh, read.shapes
    arrays: dict[str, NDArray[Any]] = {
        "positions": add_centre(mesh.positions, mesh.centre),
        "faces": mesh.faces,
        "uv": mesh.uv,
        "face_uv": mesh.face_uv,
    }
    if shapes is not None:
        arrays["shapes"] = add_centre(shapes.positions, mesh.centre)
        arrays["names"] = np.array(shapes.names, np.str_)
    return arrays


def _write_frames(
    member: IO[bytes], mesh: Mesh, frames: Iterable[NDArray[np.float32]], count: int
) -> None:
    kind = np.dtype("<f8" if mesh.centre.any() else "<f4")
    shape = (count, *mesh.positions.shape)
    header = {"descr": kind.str, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(member, header)
    for frame in frames:
        member.write(np.ascontiguousarray(add_centre(frame, mesh.centre), kind).tobytes())


def _member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    # Of one date, so that the same content has the same bytes.
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)
