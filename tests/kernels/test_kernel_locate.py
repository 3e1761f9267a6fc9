"""Point in triangle and distance to a triangle, one by one, against double."""

from __future__ import annotations

import numpy as np

from kernels.one_line import evaluate
from reference.drawing import segment_distance
from reference.locate import depth_inside, nearest_on_triangle

HOLDS = "holds((uv_triangle){a, b, c}, p.x, p.y)"
# A rounding of coordinates within the UDIM, times the operations of a cross product.
ROUNDING = 2.0**-21


def named(a, b, c, p):
    return {"a": a, "b": b, "c": c, "p": p}


def scene(seed, count=3000):
    """Triangles and points of the unit square, float32: a, b, c, p of (n, 2)."""
    rng = np.random.default_rng(seed)
    return [*rng.uniform(0, 1, (4, count, 2)).astype(np.float32)]


def test_points_well_inside_are_held_and_points_outside_are_not(device):
    a, b, c, p = scene(1)
    found = evaluate(device, "locate", HOLDS, named(a, b, c, p), np.int32)
    for held, *triangle, point in zip(found, a, b, c, p, strict=True):
        depth = depth_inside(point[None].astype(float), np.array(triangle, np.float64))[0]
        assert abs(depth) < ROUNDING or bool(held) == (depth > 0)


def test_edges_corners_and_both_orientations_count_as_inside(device):
    a, b, c = np.array([[0, 0], [1, 0], [0.25, 1]], np.float32)
    points = np.array([a, b, c, [0.5, 0], [0.125, 0.5], [0.625, 0.5], [0.25, 0.25]], np.float32)
    for order in ((a, b, c), (c, b, a), (b, a, c)):
        rows = [np.tile(corner, (len(points), 1)) for corner in order]
        assert evaluate(device, "locate", HOLDS, named(*rows, points), np.int32).all()


def test_no_point_falls_between_two_triangles_that_share_an_edge(device):
    a, b, c, d, p = edges_with_neighbours(2)
    first = evaluate(device, "locate", HOLDS, named(a, b, c, p), np.int32)
    second = evaluate(device, "locate", HOLDS, named(b, a, d, p), np.int32)
    np.testing.assert_array_equal(first | second, 1)


def edges_with_neighbours(seed, count=20000):
    """Edges a b with a corner c left of them and a corner d right, and points p on the edge, but
    for the rounding to float32."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.3, 0.7, (2, count, 2)).astype(np.float32)
    along = b.astype(float) - a
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    share, *offsets = rng.uniform(0.1, 0.9, (5, count, 1))
    c = a + offsets[0] * along + offsets[1] * across
    d = a + offsets[2] * along - offsets[3] * across
    return [x.astype(np.float32) for x in (a, b, c, d, a + share * along)]


def test_squared_distance_to_a_segment_is_that_of_double(device):
    a, b, c, p = scene(3)
    wanted = [
        np.square(segment_distance(q[None], s, e)[0])
        for q, s, e in zip(*(x.astype(np.float64) for x in (p, a, b)), strict=True)
    ]
    found = evaluate(device, "locate", "segment_distance2(a, b, p.x, p.y)", named(a, b, c, p))
    np.testing.assert_allclose(np.sqrt(found), np.sqrt(wanted), atol=ROUNDING, rtol=0)


def test_distance_does_not_depend_on_the_order_of_ends_or_corners(device):
    a, b, c, p = scene(4)
    b[::3, 0] = a[::3, 0]  # upright edges: the order is decided by v
    one = evaluate(device, "locate", "segment_distance2(a, b, p.x, p.y)", named(a, b, c, p))
    other = evaluate(device, "locate", "segment_distance2(b, a, p.x, p.y)", named(a, b, c, p))
    np.testing.assert_array_equal(one, other)
    distance = "triangle_distance2((uv_triangle){a, b, c}, p.x, p.y)"
    one = evaluate(device, "locate", distance, named(a, b, c, p))
    for order in ((c, a, b), (b, a, c), (c, b, a)):
        np.testing.assert_array_equal(evaluate(device, "locate", distance, named(*order, p)), one)


def test_distance_to_a_triangle_is_that_of_double(device):
    a, b, c, p = scene(5)
    distance = "triangle_distance2((uv_triangle){a, b, c}, p.x, p.y)"
    found = np.sqrt(evaluate(device, "locate", distance, named(a, b, c, p)))
    for got, *triangle, point in zip(found, a, b, c, p, strict=True):
        wanted = nearest_on_triangle(point[None].astype(float), np.array(triangle, np.float64))[1]
        assert abs(got - wanted[0]) <= ROUNDING
