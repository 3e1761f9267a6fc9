"""Expressions of a face: shapes with names, or frames, that lines grow by."""

from __future__ import annotations

from pathlib import PurePath

from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import ORIGIN, Centre
from rhytid.errors import FrameError
from rhytid.formats.frames import read_frame_file
from rhytid.formats.limits import MAX_FRAME_NUMBERS
from rhytid.formats.npz import Archive

SHAPE_EXTENSIONS = (".npz", ".npy")


def read_expressions(data: bytes, name: str, vertices: int, centre: Centre = ORIGIN) -> Expressions:
    """The expressions in the bytes of a file called `name`.

    .npz holds `shapes` (E, V, 3) positions and optionally `names` (E,), or else `frames`
    (N, V, 3); .npy is an array (E, V, 3). Raises FrameError naming what is wrong, or LimitError.
    """
    extension = PurePath(name).suffix.lower()
    if extension == ".npz":
        shapes = npz_shapes(data, vertices, centre)
        if shapes is not None:
            return shapes
    elif extension != ".npy":
        known = ", ".join(SHAPE_EXTENSIONS)
        raise FrameError(f"shapes with extension {extension!r}: must be one of {known}")
    # These are less the centre already.
    return Expressions.checked(read_frame_file(data, name, vertices, centre), vertices)


def npz_shapes(data: bytes, vertices: int, centre: Centre = ORIGIN) -> Expressions | None:
    """The members `shapes` and `names`; None where there is no `shapes`."""
    archive = Archive(data, FrameError)
    if "shapes" not in archive:
        return None
    names = None
    if "names" in archive:
        texts = archive.read("names", names=True)
        if texts.ndim != 1:
            raise FrameError(f"names have shape {texts.shape}, not (E,)")
        names = [str(text) for text in texts]
    shapes = archive.read("shapes", MAX_FRAME_NUMBERS)
    return Expressions.checked(shapes, vertices, names, centre)
