from __future__ import annotations

import numpy as np

from rhytid.cli.preview import touched_squares
from rhytid.pictures.surface_patch import Frame, surface_patch
from rhytid_lab.samples.sphere import sphere


def test_a_patch_reads_no_texel_that_is_not_drawn() -> None:
    mesh = sphere(24)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    whole = np.random.default_rng(3).normal(size=(256, 256))
    for t in np.argsort(-corners.mean(axis=1)[:, 2])[:200:10]:
        surface = surface_patch(corners, mesh.triangle_uv(), Frame.of(corners[t]), 0.3, 64)
        drawn = np.full_like(whole, np.nan)
        squares = touched_squares([surface], 256, 4)
        assert 1 < len(squares) < 100
        for row, column in squares:
            drawn[row : row + 4, column : column + 4] = whole[row : row + 4, column : column + 4]
        np.testing.assert_array_equal(surface.heights(drawn), surface.heights(whole))
        np.testing.assert_array_equal(surface.gradient(drawn), surface.gradient(whole))
