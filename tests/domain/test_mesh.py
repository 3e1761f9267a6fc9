"""A mesh and what it remembers."""

from __future__ import annotations

import pickle

import numpy as np

from meshes import bumpy_grid
from rhytid.domain.mesh import Mesh


def test_what_was_found_of_a_mesh_is_kept_here_and_not_sent_on() -> None:
    mesh = Mesh(*bumpy_grid(4, seed=1))
    used = mesh.usable_triangles()
    assert mesh.usable_triangles() is used
    assert not used.flags.writeable
    assert not mesh.triangles_with_uv().flags.writeable
    sent = pickle.dumps(mesh)
    assert b"_usable" not in sent
    again = pickle.loads(sent)
    assert again.same(mesh)
    np.testing.assert_array_equal(again.usable_triangles(), used)
