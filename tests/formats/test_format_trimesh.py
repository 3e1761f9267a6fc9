"""Files that another program wrote: trimesh, of the same mesh, in every format that it exports."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from meshes import SmallMesh
from rhytid.formats.meshes import read_mesh


@pytest.fixture
def exported(small_mesh: SmallMesh) -> trimesh.Trimesh:
    """One uv a vertex, as glTF and trimesh's OBJ want it."""
    corners = small_mesh.faces.reshape(-1)
    return trimesh.Trimesh(
        vertices=small_mesh.positions[corners],
        faces=np.arange(len(corners)).reshape(-1, 3),
        visual=trimesh.visual.TextureVisuals(uv=small_mesh.uv[small_mesh.face_uv.reshape(-1)]),
        process=False,
    )


@pytest.mark.parametrize("format", ["glb", "obj"])
def test_triangles_and_uv_are_those_written(exported: trimesh.Trimesh, format: str) -> None:
    data = exported.export(file_type=format)
    mesh = read_mesh(data if isinstance(data, bytes) else data.encode(), f"mesh.{format}").mesh

    np.testing.assert_allclose(mesh.positions[mesh.faces], exported.triangles, atol=1e-6)
    np.testing.assert_allclose(mesh.triangle_uv(), written_uv(exported), atol=1e-6)


def written_uv(mesh: trimesh.Trimesh) -> NDArray[np.float64]:
    corners: NDArray[np.float64] = np.asarray(mesh.visual.uv)[mesh.faces]
    return corners
