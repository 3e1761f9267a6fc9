"""The animation of the demo: that of the built-in face, or the user's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.baking.frames import FrameFiles
from rhytid.baking.input_files import mesh_file, shape_files
from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.formats.frame_set import Clip
from rhytid.formats.meshes import MeshFile
from rhytid.support.atomic_files import atomic_write
from rhytid_lab.samples.face import procedural_face

MESH_ARRAYS = ("positions", "faces", "uv", "face_uv")
KEYS = ("brow_raise", "brow_furrow", "smile", "jaw_open")
# Half an expression, all of it, half of it, none: four frames each, after a neutral one.
FRAMES = 4 * len(KEYS) + 1


@dataclass(frozen=True, eq=False)
class Animation:
    """A neutral mesh, the frames that deform it, and expressions that its lines grow by.  file: of
    the mesh, as it was read."""

    mesh: Mesh
    frames: FrameFiles
    expressions: Expressions | None
    unit: str | None
    file: MeshFile

    @property
    def shapes(self) -> dict[str, NDArray[np.float32]] | None:
        """Positions (V, 3) by the names of the expressions."""
        if self.expressions is None:
            return None
        return dict(zip(self.expressions.names, self.expressions.positions, strict=True))

    def save(self, file: Path) -> None:
        """Write both as a .npz that every command and the server read."""
        arrays = {name: getattr(self.mesh, name) for name in MESH_ARRAYS}
        frames = np.stack([self.frames.read(place) for place in self.frames.places])
        shapes = self.shapes or {}
        if shapes:
            arrays |= {"shapes": np.stack(list(shapes.values())), "names": np.array(list(shapes))}
        with atomic_write(file) as aside:
            np.savez(aside, **arrays, frames=frames)


def animation(
    mesh: Path | None, frames: Sequence[Path], shapes: Path | None = None, clip: Clip | None = None
) -> Animation:
    """The animation of the user's files, or the built-in one where there is no mesh.

    Raises MeshError or FrameError naming what cannot be used.
    """
    if mesh is None:
        sample = procedural_face()
        poses = np.stack([sample.pose({name: 1.0}) for name in sample.expressions])
        own = Expressions.checked(poses, len(sample.mesh.positions), list(sample.expressions))
        found = MeshFile(sample.mesh, sample.animation(KEYS, FRAMES), own)
    else:
        found = mesh_file(mesh, clip)
    files, expressions = FrameFiles(found, frames, clip), shape_files(shapes, found, clip)
    return Animation(found.mesh, files, expressions, found.unit, found)
