"""The picture of a whole mesh with its relief."""

from __future__ import annotations

import numpy as np

from rhytid.domain.mesh import Mesh
from rhytid.pictures.surface_patch import whole_picture
from rhytid_lab.samples.grids import flat_sheet

WIDE, PIXELS = 2.0, 80


def two_sheets() -> Mesh:
    """A small sheet in UDIM 1002 before a large one in 1001, both facing +z."""
    back, front = flat_sheet(WIDE, 8), flat_sheet(WIDE / 2, 8)
    return Mesh(
        np.concatenate([back.positions, front.positions + np.float32([0, 0, 0.5])]),
        np.concatenate([back.faces, front.faces + len(back.positions)]),
        np.concatenate([back.uv, front.uv + np.float32([1, 0])]),
        np.concatenate([back.face_uv, front.face_uv + len(back.uv)]),
    )


def test_the_nearest_udim_is_seen_in_any_order() -> None:
    mesh, flat = two_sheets(), np.zeros((64, 64), np.float32)
    waves = np.repeat(0.01 * np.sin(np.arange(64) * 0.8)[:, None], 64, axis=1).astype(np.float32)
    maps = {1001: flat, 1002: waves}
    found = whole_picture(mesh, mesh.positions, maps.items(), PIXELS)
    again = whole_picture(mesh, mesh.positions, list(maps.items())[::-1], PIXELS)
    assert (found == again).all()
    middle, around = found[30:50, 30:50], found[6:14, 6:74]
    assert middle.std(axis=(0, 1)).min() > 10  # waves, which the sheet behind has not
    assert around.std(axis=(0, 1)).max() < 1
    assert (around < 255).all()
    assert (found[0] == 255).all()  # beside the mesh


def test_positions_are_those_of_the_frame() -> None:
    mesh = two_sheets()
    moved = mesh.positions * np.float32([0.5, 1, 1])
    found = whole_picture(mesh, moved, [(1001, np.zeros((64, 64), np.float32))], PIXELS)
    assert (found[40, [8, 72]] == 255).all()
    assert (found[40, [24, 56]] < 255).all()
