"""The picture of `rhytid check`: triangles have the colour of their problem, in space and in UV."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes import SmallMesh
from rhytid.domain.mesh import Mesh
from rhytid.pictures.check import MOST_UDIMS, SIDE, check_picture, problems_of


def picture(
    mesh: Mesh, mask: NDArray[np.bool_], udims: tuple[int, ...] = (1001,)
) -> NDArray[np.int64]:
    drawn = check_picture(mesh, udims, problems_of({"flipped": mask}), "a sheet")
    return np.asarray(drawn).astype(np.int64)


def pink(pixels: NDArray[np.int64]) -> int:
    """Pixels that are more pink than any grey."""
    red, green, blue = np.moveaxis(pixels, -1, 0)
    return int(((red - green > 40) & (blue - green > 20)).sum())


@pytest.mark.slow
def test_half_a_mesh_is_coloured(small_mesh: SmallMesh) -> None:
    mesh = Mesh(*small_mesh)
    none, half = np.zeros(200, bool), np.arange(200) < 100
    more = pink(picture(mesh, half)) - pink(picture(mesh, none))
    chart = (half @ np.abs(np.linalg.det(np.diff(mesh.triangle_uv(), axis=1)))) / 2 * SIDE**2

    assert more > chart * 1.5, "in UV, and in space at least half as much"


@pytest.mark.slow
def test_udims_have_panels_up_to_a_number(small_mesh: SmallMesh) -> None:
    mask = np.zeros(200, bool)
    heights = [
        len(picture(Mesh(*small_mesh), mask, tuple(range(1001, 1001 + n)))) for n in (1, 4, 9)
    ]

    assert heights[1] - heights[0] == pytest.approx(SIDE, abs=60)
    assert heights[2] == heights[1]
    assert MOST_UDIMS == 6
