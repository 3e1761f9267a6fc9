"""A wrinkle graph under stretch, drawn anew (section 2.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.cushion import Cushion, raised, strengths
from reference.drawing import Pores, Wrinkles, disc_metric, draw
from reference.inputs import Array, Graph, Response, Shape
from reference.response import on_surface, pore_stretch, scales, wrinkle_stretch
from reference.waves import Waves

ORIGIN = (0.0, 0.0)
Stretch = tuple[Array, Array]


def segments(graph: Graph, origin: ArrayLike = ORIGIN) -> Array:
    """(M, 2, 2) ends of the wrinkles, local to the UDIM whose lower left corner is `origin`."""
    local = np.asarray(graph.node_uv, np.float64) - np.asarray(origin, np.float64)
    ends: Array = local[np.asarray(graph.edge_nodes)]
    return ends


def centres(graph: Graph) -> Array:
    """(M, 2) midpoints of the wrinkles, UDIM offset included."""
    midpoints: Array = segments(graph).mean(axis=1)
    return midpoints


def directions(graph: Graph) -> Array:
    """(M, 2) unit vectors along the wrinkles."""
    along = np.diff(segments(graph), axis=1)[:, 0]
    return along / np.linalg.norm(along, axis=-1, keepdims=True)


def wrinkles(
    graph: Graph,
    width: ArrayLike = 1.0,
    depth: ArrayLike = 1.0,
    origin: ArrayLike = ORIGIN,
    waves: Waves | None = None,
) -> Wrinkles:
    """What is drawn for the edges under σ_w = `width` and σ_d = `depth`, scalars or (M,)."""
    half_width = np.asarray(graph.edge_half_width, np.float64) * np.asarray(width)
    strength = np.asarray(graph.edge_weight, np.float64) * np.asarray(depth)
    return Wrinkles(segments(graph, origin), half_width, strength, waves, metric=line_metric(graph))


def line_metric(graph: Graph) -> Array | None:
    """(M, 3) in which the rim of a wrinkle with a metric is its half width from its line."""
    if graph.edge_metric is None:
        return None
    half_width = np.asarray(graph.edge_half_width, np.float64)[:, None]
    metric: Array = np.asarray(graph.edge_metric, np.float64) * half_width**2
    return metric


def pores(
    graph: Graph, width: ArrayLike = 1.0, depth: ArrayLike = 1.0, origin: ArrayLike = ORIGIN
) -> Pores:
    """What is drawn for the nodes under σ_w = `width` and σ_d = `depth`, scalars or (N,)."""
    metric = disc_metric(graph.node_radius)
    if graph.node_metric is not None:
        metric = np.asarray(graph.node_metric, np.float64)
    scaled = metric / np.square(np.asarray(width, np.float64))[..., None]
    strength = np.asarray(graph.node_weight, np.float64) * np.asarray(depth)
    place = np.asarray(graph.node_uv, np.float64) - np.asarray(origin, np.float64)
    return Pores(place, scaled, strength)


def neutral(
    points: Array, graph: Graph, shape: Shape, depth: float, origin: ArrayLike = ORIGIN
) -> Array:
    """(P,) displacement of the undeformed face; points (P, 2) are local to the UDIM."""
    return draw(points, wrinkles(graph, origin=origin), pores(graph, origin=origin), shape, depth)


def redraw(
    points: Array,
    graph: Graph,
    at_wrinkles: Stretch,
    at_pores: Stretch,
    response: Response,
    shape: Shape,
    depth: float,
    origin: ArrayLike = ORIGIN,
    jacobian: Array | None = None,
    waves: Waves | None = None,
    cushion: Cushion | None = None,
) -> Array:
    """(P,) displacement under stretch.

    at_wrinkles, at_pores: clamped log stretch (M, 2) and axes (M, 2, 2) at the centres.
    jacobian: (M, 2, 2) at the wrinkles, to take angles on the surface.
    """
    (logs, axes), theta = at_wrinkles, directions(graph)
    if jacobian is not None:
        axes, theta = on_surface(jacobian[:, None], axes), on_surface(jacobian, theta)
    r = wrinkle_stretch(logs, axes, theta)
    lines = wrinkles(graph, *scales(r, response.alpha_w, response.alpha_d), origin, waves)
    r = pore_stretch(at_pores[0])
    discs = pores(graph, *scales(r, response.beta_w, response.beta_d), origin)
    if cushion is None:
        return draw(points, lines, discs, shape, depth)
    narrow, broad = strengths(graph.edge_weight, cushion.share)
    sigma_d = scales(wrinkle_stretch(logs, axes, theta), response.alpha_w, response.alpha_d)[1]
    swelling = depth * raised(points, lines._replace(strength=broad * sigma_d), cushion)
    return swelling + draw(points, lines._replace(strength=narrow * sigma_d), discs, shape, depth)
