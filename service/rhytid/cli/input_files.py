"""Reading the files that a command line names; what is wrong with one is told with its name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.controls import Controls
from rhytid.domain.expressions import Expressions, evenly
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.origin import ORIGIN, Centre
from rhytid.domain.stiffness import Stiffness
from rhytid.domain.tiles import mesh_udims
from rhytid.errors import InputError, LimitError
from rhytid.formats.expressions import read_expressions
from rhytid.formats.frames import read_frame_file
from rhytid.formats.graphs import read_graph
from rhytid.formats.meshes import MeshFile, read_mesh
from rhytid.formats.painted import read_controls, read_stiffness


def mesh_file(file: Path) -> MeshFile:
    """A neutral mesh, with the frames of a .npz that holds them."""
    with _named(file):
        return read_mesh(file.read_bytes(), file.name)


def frame_file(file: Path, vertices: int, centre: Centre = ORIGIN) -> NDArray[np.float32]:
    """(N, V, 3) positions, less the centre of their mesh: the frames of one file."""
    with _named(file):
        return read_frame_file(file.read_bytes(), file.name, vertices, centre)


def shape_files(place: Path | None, mesh: MeshFile) -> Expressions | None:
    """The expressions in a file, or in the OBJ files of a folder, by their names; of the mesh file
    where nothing is named."""
    if place is None:
        return mesh.expressions
    vertices, centre = len(mesh.mesh.positions), mesh.mesh.centre
    if not place.is_dir():
        with _named(place):
            return read_expressions(place.read_bytes(), place.name, vertices, centre)
    every = sorted(f for f in place.iterdir() if f.suffix.lower() == ".obj" and f.is_file())
    if not every:
        raise InputError(f"{place}: no OBJ files there")
    files = [every[i] for i in evenly(len(every))]
    read = [frame_file(file, vertices, centre)[0] for file in files]
    return Expressions.checked(np.stack(read), vertices, [file.stem for file in files])


def graph_file(file: Path) -> WrinkleGraph:
    """A wrinkle graph."""
    with _named(file):
        return read_graph(file.read_bytes())


def stiffness_files(files: Sequence[Path], mesh: Mesh) -> Stiffness | None:
    """Stiffness maps by the UDIM in their names; None where there are no files."""
    images = [(str(file), file.read_bytes()) for file in files]
    return read_stiffness(images, mesh_udims(mesh)) if images else None


def control_files(files: Mapping[str, Sequence[Path]], mesh: Mesh) -> Controls | None:
    """Control maps of synthesis by name, and by the UDIM in the names of their files."""
    images = {
        name: [(str(file), file.read_bytes()) for file in named] for name, named in files.items()
    }
    return read_controls(images, mesh_udims(mesh))


@contextmanager
def _named(file: Path) -> Iterator[None]:
    try:
        yield
    except (InputError, LimitError) as error:
        raise type(error)(f"{file}: {error}") from error
