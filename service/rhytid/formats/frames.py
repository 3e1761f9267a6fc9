"""Frames and shapes of a mesh: bodies of requests, and files of the command line."""

from __future__ import annotations

from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.domain.frame import check_positions
from rhytid.domain.mesh import ORIGIN, Centre, Mesh
from rhytid.domain.wording import plural
from rhytid.errors import FrameError, InputError, MeshError, ShapesError
from rhytid.formats.limits import MAX_FRAME_NUMBERS, check_size
from rhytid.formats.npz import check_frames, read_npz_expressions, read_npz_frames
from rhytid.formats.npz_archive import NpyHeader, read_npy_header
from rhytid.formats.obj import read_obj_positions

NPY = "application/x-npy"
RAW = "application/octet-stream"
FRAME_EXTENSIONS = (".npy", ".npz", ".obj")
SHAPE_EXTENSIONS = (".npz", ".npy")


def read_positions(
    body: bytes,
    media_type: str,
    vertices: int,
    centre: Centre = ORIGIN,
    what: str = "frame",
) -> NDArray[np.float32]:
    """(V, 3) float32 positions of one frame, less the centre of its mesh, read-only, in mesh units.

    `media_type` is NPY, or RAW for little-endian float32 without a header.  what: words for the
    frame in errors. Raises FrameError naming the counts, the first vertex that is not
    finite, or the media types known here.
    """
    kind = media_type.partition(";")[0].strip().lower()
    if kind == RAW:
        if len(body) != 12 * vertices:
            held = plural(vertices, "vertex of 3 float32 is", "vertices of 3 float32 are")
            raise FrameError(f"{what} is {len(body)} bytes: {held} {12 * vertices}")
        return check_positions(np.frombuffer(body, "<f4").reshape(-1, 3), vertices, centre, what)
    if kind == NPY:
        header = _npy_header(body, what, FrameError)
        if header.shape != (vertices, 3):
            raise FrameError(f"{what} has shape {header.shape}, not ({vertices}, 3)")
        return check_positions(header.array(body), vertices, centre, what)
    raise FrameError(f"{what} of media type {media_type!r:.80}: must be {NPY} or {RAW}")


def read_frame_file(
    data: bytes, name: str, vertices: int, centre: Centre = ORIGIN
) -> NDArray[np.float32]:
    """(N, V, 3) float32, less the centre of their mesh, read-only: the frames in the bytes of a
    file called `name`.

    .npy holds (V, 3) or (N, V, 3); .npz a member `frames` (N, V, 3); of .obj the vertices are
    read, one frame, and there may be no faces. Raises FrameError (MeshError's text for an OBJ
    line) or LimitError.
    """
    extension = PurePath(name).suffix.lower()
    if extension == ".npy":
        array = _npy_header(data, "the file", FrameError).array(data)
        return check_frames(array[None] if array.ndim == 2 else array, vertices, centre)
    if extension == ".npz":
        return read_npz_frames(data, vertices, centre)
    if extension == ".obj":
        return check_positions(_obj(data), vertices, centre)[None]
    known = ", ".join(FRAME_EXTENSIONS)
    raise FrameError(f"frame file with extension {extension!r}: must be one of {known}")


def read_expressions(data: bytes, name: str, mesh: Mesh) -> Expressions:
    """The expressions of a mesh in the bytes of a file called `name`.

    .npz holds `shapes` (E, V, 3) positions and optionally `names` (E,), or else `frames`
    (N, V, 3); .npy is an array (E, V, 3). Raises ShapesError naming what is wrong, offsets in place
    of positions too, or LimitError.
    """
    found = _expressions(data, name, len(mesh.positions), mesh.centre)
    found.check_size(mesh.positions)
    return found


def _expressions(data: bytes, name: str, vertices: int, centre: Centre) -> Expressions:
    extension = PurePath(name).suffix.lower()
    if extension == ".npz":
        return read_npz_expressions(data, vertices, centre)
    if extension != ".npy":
        known = ", ".join(SHAPE_EXTENSIONS)
        raise ShapesError(f"shapes with extension {extension!r}: must be one of {known}")
    array = _npy_header(data, "the file", ShapesError).array(data)
    return Expressions.checked(array[None] if array.ndim == 2 else array, vertices, None, centre)


def _npy_header(data: bytes, what: str, error: type[InputError]) -> NpyHeader:
    header = read_npy_header(data, what, error)
    check_size(what, header.numbers, MAX_FRAME_NUMBERS)
    promised = header.start + header.stored
    if len(data) != promised:
        raise error(f"{what}: the header promises {promised} bytes, there are {len(data)}")
    return header


def _obj(data: bytes) -> NDArray[np.float64]:
    try:
        return read_obj_positions(data)
    except MeshError as exc:
        raise FrameError(str(exc)) from exc
