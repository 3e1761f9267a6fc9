"""Soft masks of regions of the skin, from the places that expressions of known names move and fold.

No expression moves the nose or the neck alone: the nose lies between what a sneer moves, the neck
below what an open jaw carries away. The form of the face shows where. The red of the lips is full,
and ends where its form is not any more; on a face without such lips it ends where it rolls in. The
mouth around it is what a pucker carries along."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.blendshapes import region_of, rolls_lips
from rhytid.domain.mesh import Mesh
from rhytid.domain.skin import FINE
from rhytid.pipeline.diffusion import Diffusion
from rhytid.support import cancellation

FloatArray = NDArray[np.float64]
# The vertical axis of a mesh.
_UP = np.array([0.0, 1.0, 0.0])
# In half the distance of what a sneer moves on both sides: the nose is so wide, reaches so far
# below and above its tip, and so far in front of the cheeks, as a share of the tip.
_ACROSS, _BELOW, _ABOVE, _FRONT = (1.2, 0.85), (-0.85, -0.6), (1.6, 1.1), (0.04, 0.24)
# The tip stands out by so much, and is looked for within so much of the middle.
_LEAST_TIP, _TIP_REACH = 0.35, (0.5, 1.6)
# Of the motion of a sneer, what its middle moves at most, if it moves both sides.
_MOST_MIDDLE = 0.5
# What an open jaw carries: the chin at least, the neck at most; shares of the largest motion.
_CHIN, _CARRIED = 0.85, (0.65, 0.3)
# Below the chin, in the length that smooths: where the neck begins, is whole, ends and has ended.
_NECK_BEGINS, _NECK_ENDS = (0.0, 3.5), (44.0, 32.0)
# The floor of the mouth is neck, too: how far skin faces down, the sine of its slope; how far above
# the lowest of the chin it ends and is whole; and of an open jaw, where it begins and is whole.
_FACES_DOWN, _UNDER_CHIN, _WITH_JAW = (0.55, 0.75), (-2.4, -1.0), (0.05, 0.2)
# By region: powers of motion and of folds whose product tells it, as shares of their most, and at
# which it begins and is whole. By eye on two faces: brows carry the skin of the lids up with them,
# but fold the forehead alone; lips move most in a pucker, and fold as much as what is around them;
# what puffs, squints and smiles together is the cheek.
_FOLDS = {
    "forehead": (0.0, 1.0, 0.25, 0.55),
    "eye_corner": (0.5, 0.5, 0.22, 0.5),
    "lip": (1.0, 0.0, 0.65, 0.92),
    "cheek": (1.0, 0.0, 0.25, 0.55),
}
# Those that lie beside what moves.
_BESIDE = ("nose", "neck")
# What the others leave: a smile moves the corners of the lips, and much around the nose, too. The
# mouth has what its neighbours leave.
_LEFT = "cheek"
_AROUND = ("lip", "nose", "neck")
# How far the border of the lips is smoothed, of what other masks are: by motion, and by form, where
# it lies between two vertices.
_BORDER, _BORDER_OF_FORM = 0.17, 0.42
# What rolls in turns about the border of a lip: within this distance, in the length that smooths
# regions, the border moves about three quarters of what moves most.
_NEAR = 1.7
# That most is at least so much of what the roll moves anywhere: beyond the corners of the mouth it
# is no lip.
_LEAST_ROLL = 0.35
# Of the product of both, in a roll and in a pucker: where the lip begins and is whole. By eye on
# one face: at the borders of its middle it is 0.58 and 0.6.
_LIP = (0.50, 0.68)
# Without rolls: of the motion in a pucker.
_PUCKERED = (0.72, 0.9)
# What is full is bent outwards, both ways together, at so much in one over the length that smooths
# regions: where the lip begins and is whole; of the form that is as smooth as a share of that
# length leaves it.
_FULL, _FORM = (0.2, 0.66), 0.3
# Of the motion in a pucker: where a lip can begin and can be whole, and from where on there is no
# other skin, at the slit and its corners, which are not full.
_PURSED, _SLIT = (0.5, 0.66), 0.86
# One lip has at least this share of the other. Where an open mouth parts them they join at its
# corners alone, where a pucker may move them less than at the slit.
_OTHER_LIP = 0.25
# The form tells the border where so much of it at least is full.
_TOLD = 0.5
# Of the motion in a pucker and of an open jaw: where the mouth and the chin begin and are whole.
_MOUTH, _CARRIED_CHIN = (0.22, 0.5), (0.72, 0.86)
# Vertices at a time whose neighbours are held: of a dense mesh each has thousands.
_ROWS = 256


class RegionMasks:
    """Collects what the expressions of one mesh show of regions, one expression after the other.

    anatomy: how finely regions are told apart.
    """

    def __init__(self, mesh: Mesh, anatomy: str = FINE) -> None:
        self._mesh, self._fine = mesh, anatomy == FINE
        self._rolls: list[FloatArray] = []
        self._shown: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
        self._moved: dict[str, FloatArray] = {}

    def add(self, name: str, positions: NDArray[np.float32], folds: NDArray[np.float32]) -> None:
        """Add one expression that moves something.  folds (F, 3): the result of
        `FoldStage.measure`."""
        region = region_of(name)
        rolls = self._fine and rolls_lips(name)
        if region is None and not rolls:
            return
        offsets = positions.astype(np.float64) - self._mesh.positions
        if region is None:
            self._rolls.append(np.linalg.norm(offsets, axis=1))
            return
        if region in _BESIDE:
            self._moved[region] = self._moved.get(region, 0.0) + offsets
            return
        compression = folds[:, 0].astype(np.float64) + folds[:, 1]
        motion = np.linalg.norm(offsets, axis=1)
        self._shown.setdefault(region, []).append((motion, compression))

    def masks(self, surface: Diffusion) -> dict[str, NDArray[np.float32]]:
        """The share (V,), 0 to 1, of each region that was shown, at every vertex, by its name."""
        shares = {region: self._by_shapes(region, surface) for region in self._shown}
        shares |= self._beside(surface)
        found = {}
        for region, share in sorted(shares.items()):
            soft = surface.of_vertices(share[:, None])[:, 0]
            found[region] = np.clip(soft, 0.0, 1.0)
        if self._fine and "lip" in found:
            self._part_mouth(found, surface)
        if _LEFT in found:
            for region in sorted(found.keys() - {_LEFT}):
                found[_LEFT] = found[_LEFT] * (1.0 - found[region])
        return {region: mask.astype(np.float32) for region, mask in found.items()}

    def _part_mouth(self, found: dict[str, FloatArray], surface: Diffusion) -> None:
        """Put the lips up to their border in the place of where a pucker moves most, and the mouth
        around them beside."""
        pucker = np.maximum.reduce([_share(motion) for motion, _ in self._shown["lip"]])
        jaw = self._moved.get("neck")
        jaw = None if jaw is None else _share(np.linalg.norm(jaw, axis=1))
        places = self._mesh.positions.astype(np.float64)
        lip, border = full_share(self._mesh, surface, pucker), _BORDER_OF_FORM
        if lip is None:
            lip, border = lip_share(places, self._rolls, pucker, surface.sigma), _BORDER
        soft = surface.narrower(border).of_vertices(lip[:, None])[:, 0]
        found["lip"] = np.clip(soft, 0.0, 1.0)
        around = surface.of_vertices(mouth_share(pucker, jaw)[:, None])[:, 0]
        found["mouth"] = np.clip(around, 0.0, 1.0)
        for region in _AROUND:
            found["mouth"] = found["mouth"] * (1.0 - found.get(region, 0.0))

    def _by_shapes(self, region: str, surface: Diffusion) -> FloatArray:
        """(V,) where the expressions of a region move and fold most."""
        shown = self._shown[region]
        by_motion, by_folds, begins, whole = _FOLDS[region]
        folds = surface.of_triangles(np.stack([c for _, c in shown], axis=-1))
        shares = [
            _share(motion) ** by_motion * _share(np.sqrt(np.maximum(fold, 0.0))) ** by_folds
            for (motion, _), fold in zip(shown, folds.T, strict=True)
        ]
        return ramp(np.maximum.reduce(shares), begins, whole)

    def _beside(self, surface: Diffusion) -> dict[str, FloatArray]:
        """(V,) shares of the nose and of the neck, of those that the form of the face shows."""
        found = {}
        if "nose" in self._moved:
            found["nose"] = nose_share(self._mesh, surface.normals, self._moved["nose"])
        if "neck" in self._moved:
            facing = surface.normals if self._fine else None
            found["neck"] = neck_share(self._mesh, self._moved["neck"], surface.sigma, facing)
        return {region: share for region, share in found.items() if share is not None}


def _share(values: Any) -> FloatArray:
    share: FloatArray = values / max(float(values.max()), 1e-30)
    return share


def nose_share(mesh: Mesh, normals: FloatArray, offsets: FloatArray) -> FloatArray | None:
    """(V,) how far vertices are of the nose, 0 to 1; None where a sneer does not show it.

    normals: (V, 3), outward.  offsets: (V, 3) what sneers move, both sides together. Up is the way
    they move the skin, forward the way it faces there; no axis of the mesh is asked for.
    """
    weight = (offsets**2).sum(axis=1)
    if not weight.any():
        return None
    weight = weight / weight.sum()
    places = mesh.positions.astype(np.float64)
    up = _unit(weight @ offsets)
    facing = weight @ normals
    forward = _unit(facing - (facing @ up) * up)
    x, y, z = np.stack([np.cross(up, forward), up, forward]) @ (places - weight @ places).T
    half = float(np.sqrt(weight @ x**2))
    x, y, z = (axis / max(half, 1e-30) for axis in (x, y, z))
    if not _on_both_sides(np.linalg.norm(offsets, axis=1), x):
        return None
    near = (np.abs(x) < _TIP_REACH[0]) & (np.abs(y) < _TIP_REACH[1])
    tip = int(np.argmax(np.where(near, z, -np.inf)))
    if not near[tip] or z[tip] < _LEAST_TIP:
        return None
    below = y - y[tip]
    share = ramp(np.abs(x), *_ACROSS) * ramp(z / z[tip], *_FRONT)
    share *= ramp(below, *_BELOW) * ramp(below, *_ABOVE)
    return share


def neck_share(
    mesh: Mesh, offsets: FloatArray, length: float, normals: FloatArray | None = None
) -> FloatArray | None:
    """(V,) how far vertices are of the neck, 0 to 1; None where an open jaw does not show it.

    offsets: (V, 3) what opening the jaw moves, down along y.  length: that which smooths, mesh
    units.  normals: (V, 3), outward, by which the floor of the mouth counts; without them it does
    not.
    """
    motion = np.linalg.norm(offsets, axis=1)
    if not motion.any() or (motion @ offsets) @ _UP >= 0.0:
        return None
    motion = motion / motion.max()
    height = mesh.positions.astype(np.float64) @ _UP
    below = (height[motion >= _CHIN].min() - height) / length
    share = ramp(below, *_NECK_BEGINS) * ramp(below, *_NECK_ENDS) * ramp(motion, *_CARRIED)
    if share.any() and normals is not None:
        under = ramp(-(normals @ _UP), *_FACES_DOWN) * ramp(below, *_UNDER_CHIN)
        share = np.maximum(share, under * ramp(below, *_NECK_ENDS) * ramp(motion, *_WITH_JAW))
    return share if share.any() else None


def lip_share(
    places: FloatArray, rolls: Sequence[FloatArray], pucker: FloatArray, length: float
) -> FloatArray:
    """(V,) how far vertices are red of a lip, 0 to 1.

    places: (V, 3) of the vertices.  rolls: (V,) how far each roll of a lip moves them.  pucker:
    (V,) the same of a pucker, as a share of its most.  length: that smooths regions, mesh units.
    """
    if not rolls:
        return ramp(pucker, *_PUCKERED)
    rolled = np.maximum.reduce([_of_most_near(places, roll, _NEAR * length) for roll in rolls])
    return ramp(rolled * pucker, *_LIP)


def full_share(mesh: Mesh, surface: Diffusion, pucker: FloatArray) -> FloatArray | None:
    """(V,) how far vertices are red of a lip, 0 to 1, by the form of both lips: what is full, and
    what that encloses. None where the form does not show the border.

    pucker: (V,) how far a pucker moves vertices, as a share of its most.
    """
    near = ramp(pucker, *_PURSED)
    full = near * ramp(surface.bent(_FORM) * surface.sigma, *_FULL)
    edges = surface.edges
    lips = _largest(surface.as_one((full >= 0.5) | (pucker >= _SLIT)), edges, _OTHER_LIP)
    skin = _largest(~lips, edges)
    told = (lips & _touched(skin, edges))[surface.one]
    if not told.any() or np.mean(full[told] >= 0.5) < _TOLD:
        return None
    within = _largest(~skin, edges, _OTHER_LIP)
    border = np.where(_touched(within, edges)[surface.one], full, 0.0)
    share: FloatArray = np.maximum(border, within[surface.one])
    return share


def mouth_share(pucker: FloatArray, jaw: FloatArray | None) -> FloatArray:
    """(V,) how far vertices are around the mouth or of the chin, 0 to 1; lips among them.

    pucker, jaw: (V,) how far a pucker and an opening jaw move them, as shares of their most.
    """
    found = ramp(pucker, *_MOUTH)
    return found if jaw is None else np.maximum(found, ramp(jaw, *_CARRIED_CHIN))


def ramp(value: FloatArray, begins: float, whole: float) -> FloatArray:
    """From 0 to 1, linear; `whole` may be below `begins`."""
    found: FloatArray = np.clip((value - begins) / (whole - begins), 0.0, 1.0)
    return found


def _of_most_near(places: FloatArray, motion: FloatArray, reach: float) -> FloatArray:
    """(V,) motion as a share of the most of what lies within `reach`."""
    least = _LEAST_ROLL * float(motion.max())
    found = motion / max(least, 1e-30)
    moved = np.flatnonzero(motion > 0.1 * least)
    tree, most = scipy.spatial.cKDTree(places[moved]), np.empty(len(moved))
    for start in range(0, len(moved), _ROWS):
        cancellation.check()
        rows = slice(start, start + _ROWS)
        near = tree.query_ball_point(places[moved[rows]], reach)
        most[rows] = [motion[moved[beside]].max() for beside in near]
    found[moved] = motion[moved] / np.maximum(most, least)
    return found


def _largest(
    chosen: NDArray[np.bool_], edges: NDArray[np.integer], least: float = 1.0
) -> NDArray[np.bool_]:
    """(C,) the largest connected part of what is chosen (C,), and those of at least this share of
    its size."""
    kept, count = edges[chosen[edges].all(axis=1)], len(chosen)
    graph = scipy.sparse.coo_matrix((np.ones(len(kept)), kept.T), shape=(count, count))
    part = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    sizes = np.bincount(part[chosen], minlength=part.max() + 1)
    found: NDArray[np.bool_] = chosen & (sizes[part] >= least * sizes.max())
    return found


def _touched(chosen: NDArray[np.bool_], edges: NDArray[np.integer]) -> NDArray[np.bool_]:
    """(C,) what is chosen (C,) and what an edge joins to it."""
    found: NDArray[np.bool_] = chosen.copy()
    found[edges[chosen[edges].any(axis=1)]] = True
    return found


def _on_both_sides(motion: FloatArray, across: FloatArray) -> bool:
    """Whether the middle moves less: one sneer alone says nothing of where the nose is."""
    middle, beside = np.abs(across) < 0.3, (np.abs(across) > 0.7) & (np.abs(across) < 1.3)
    if not middle.any() or not beside.any():
        return False
    most = np.percentile(motion[beside], 90)
    left, right = (motion[beside & (side * across > 0)].max(initial=0.0) for side in (-1.0, 1.0))
    alike: bool = min(left, right) > _MOST_MIDDLE * max(left, right)
    return alike and bool(np.median(motion[middle]) < _MOST_MIDDLE * most)


def _unit(vector: FloatArray) -> FloatArray:
    found: FloatArray = vector / max(float(np.linalg.norm(vector)), 1e-30)
    return found
