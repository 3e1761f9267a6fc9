"""Which tiles a camera sees, against points that are scattered over the mesh."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.domain import view
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import TileAddress, TileGrid
from rhytid.domain.view import ViewedTiles
from rhytid.errors import LimitError

GRID = TileGrid(1024, 128)
UDIMS = (1001, 1002)


def ball(rows: int = 24, columns: int = 48) -> Mesh:
    """A unit ball, normals outward, over two UDIMs."""
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    up, round_ = np.pi * (v - 0.5), 2 * np.pi * u
    points = np.stack([np.cos(up) * np.cos(round_), np.cos(up) * np.sin(round_), np.sin(up)], -1)
    corner = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    uv = np.stack([2 * u, v], -1).reshape(-1, 2) * [0.98, 0.96] + [0.01, 0.02]
    return Mesh(points.reshape(-1, 3), faces, uv, faces)


BALL = ball()


def looking(eye: list[float], field: float, far: float = 100.0) -> NDArray[np.float64]:
    """Projection times view of a camera at `eye` that looks at the origin, z up."""
    forward = -np.array(eye) / np.linalg.norm(eye)
    right = np.cross(forward, [0.0, 0.1, 1.0])
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = right, np.cross(right, forward), -forward
    view[:3, 3] = -view[:3, :3] @ eye
    near, f = 0.01, 1 / np.tan(field / 2)
    projection = np.zeros((4, 4))
    projection[0, 0] = projection[1, 1] = f
    projection[2, 2:] = (far + near) / (near - far), 2 * far * near / (near - far)
    projection[3, 2] = -1
    return projection @ view


def seen_by_points(camera: NDArray[np.float64], eye: list[float], level: int) -> set[TileAddress]:
    """Tiles that hold a visible one of many points, by a normal and not by a determinant."""
    rng = np.random.default_rng(1)
    corners, uv = BALL.positions[BALL.faces].astype(float), BALL.triangle_uv()
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    found = set()
    for _ in range(40):
        share = rng.dirichlet([1, 1, 1], len(corners))
        point, at = (np.einsum("fk,fkd->fd", share, x) for x in (corners, uv))
        x, y, _, w = (np.c_[point, np.ones(len(point))] @ camera.T).T
        faces = np.einsum("fd,fd->f", normal, np.array(eye) - point) > 1e-9
        good = faces & (np.abs(x) < w) & (np.abs(y) < w)
        texel = np.floor(at[good] % 1.0 * GRID.side(level)).astype(int)
        texels = GRID.texels(level)
        for (u, v), cell in zip(texel, np.floor(at[good]).astype(int), strict=True):
            row = (GRID.side(level) - 1 - v) // texels
            found.add(TileAddress(1001 + int(cell[0]), level, int(row), int(u // texels)))
    return found


@pytest.mark.parametrize("level", [0, 2])
@pytest.mark.parametrize(
    ("eye", "field"), [([3, 0, 0], 1.0), ([0.5, 2, 1], 0.3), ([0, 0.2, 1.5], 0.1)]
)
def test_what_points_show_is_found_and_little_more(
    eye: list[float], field: float, level: int
) -> None:
    camera = looking(eye, field)
    found = ViewedTiles(BALL, UDIMS, GRID, level).seen(BALL.positions, camera)
    expected = seen_by_points(camera, eye, level)
    assert expected
    assert expected <= set(found)
    assert len(found) == len(set(found))
    # More are tiles that a visible triangle only touches.
    assert len(found) < 2 * len(expected) + 8


def test_the_middle_of_the_picture_comes_first() -> None:
    found = ViewedTiles(BALL, UDIMS, GRID, 0).seen(BALL.positions, looking([-3, 0, 0], 0.7))
    # -x is at u = 1, where the UDIMs meet, at half the height.
    assert {(at.udim, at.column) for at in found[:4]} <= {
        (1001, 7),
        (1002, 0),
        (1001, 6),
        (1002, 1),
    }
    assert {at.row for at in found[:4]} <= {3, 4}


def test_nothing_is_seen_from_inside_unless_both_sides_are() -> None:
    viewed, camera = ViewedTiles(BALL, UDIMS, GRID, 0), looking([0.0, 0.01, 0.0], 0.5)
    assert viewed.seen(BALL.positions, camera) == []
    both = viewed.seen(BALL.positions, camera, two_sided=True)
    assert 0 < len(both) < 2 * 64


@pytest.mark.parametrize("shift", [(2.5, 0), (-2.5, 0), (0, 2.5), (0, -2.5)])
def test_what_is_beside_the_picture_is_not_seen(shift: tuple[float, float]) -> None:
    matrix = np.diag([1.0, 1.0, -0.1, 1.0])
    matrix[:2, 3] = shift
    viewed = ViewedTiles(BALL, UDIMS, GRID, 0)
    assert viewed.seen(BALL.positions, matrix, two_sided=True) == []
    assert viewed.seen(BALL.positions, np.diag([1.0, 1.0, -0.1, 1.0]))


def test_a_triangle_around_the_back_of_the_camera_is_not_seen() -> None:
    corners = [[-20, -20, 5], [20, -20, 5], [0, 20, 5]]
    wide = Mesh(corners, [[0, 1, 2]], [[0.1, 0.1], [0.9, 0.1], [0.5, 0.9]], [[0, 1, 2]])
    forward = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1.0, -0.1], [0, 0, -1, 0]])
    viewed = ViewedTiles(wide, (1001,), GRID, 0)
    assert viewed.seen(wide.positions, forward, two_sided=True) == []
    assert viewed.seen(-wide.positions, forward, two_sided=True)


def test_what_is_behind_the_camera_or_too_far_is_not_seen() -> None:
    viewed, away = ViewedTiles(BALL, UDIMS, GRID, 0), looking([3, 0, 0], 0.7)
    assert viewed.seen(BALL.positions + np.float32([10, 0, 0]), away) == []
    assert viewed.seen(BALL.positions, looking([3, 0, 0], 0.7, far=1.5)) == []


def test_each_tile_that_a_triangle_meets_is_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a loop over all tiles, which takes long where a map has many."""
    uv = BALL.triangle_uv()
    low, high = uv.min(axis=1) - 2 / 1024, uv.max(axis=1) + 2 / 1024
    expected = {
        (triangle, TileAddress(udim, 0, row, column))
        for place, udim in enumerate(UDIMS)
        for row in range(8)
        for column in range(8)
        for triangle in np.flatnonzero(
            (low[:, 0] < place + (column + 1) / 8)
            & (high[:, 0] >= place + column / 8)
            & (low[:, 1] <= 1 - row / 8)
            & (high[:, 1] > 1 - (row + 1) / 8)
        ).tolist()
    }
    viewed = ViewedTiles(BALL, UDIMS, GRID, 0)
    addresses = [viewed._address(number) for number in viewed._numbers[viewed._tiles].tolist()]
    found = list(zip(viewed._triangles.tolist(), addresses, strict=True))
    assert (len(found), set(found)) == (len(expected), expected)
    monkeypatch.setattr(view, "MOST_PAIRS", 1000)
    with pytest.raises(LimitError, match=r"UDIM 1001 meet .* at most 1000"):
        ViewedTiles(BALL, UDIMS, GRID, 0)


def test_a_map_of_many_tiles_costs_what_the_triangles_meet() -> None:
    fine = TileGrid(16384, 64)
    viewed = ViewedTiles(BALL, UDIMS, fine, 0)
    seen = viewed.seen(BALL.positions, looking([3, 0, 0], 0.02))
    assert 0 < len(seen) < 65536 / 50
    assert viewed.nbytes < 1 << 23
