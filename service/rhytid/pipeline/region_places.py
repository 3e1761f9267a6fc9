"""Regions that no expression moves alone: the nose between what a sneer moves, the neck below what
an open jaw carries away. Found by the form of the face there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh

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


def neck_share(mesh: Mesh, offsets: FloatArray, length: float) -> FloatArray | None:
    """(V,) how far vertices are of the neck, 0 to 1; None where an open jaw does not show it.

    offsets: (V, 3) what opening the jaw moves, down along y.  length: that which smooths, mesh
    units.
    """
    motion = np.linalg.norm(offsets, axis=1)
    if not motion.any() or (motion @ offsets) @ _UP >= 0.0:
        return None
    motion = motion / motion.max()
    height = mesh.positions.astype(np.float64) @ _UP
    below = (height[motion >= _CHIN].min() - height) / length
    share = ramp(below, *_NECK_BEGINS) * ramp(below, *_NECK_ENDS) * ramp(motion, *_CARRIED)
    return share if share.any() else None


def ramp(value: FloatArray, begins: float, whole: float) -> FloatArray:
    """From 0 to 1, linear; `whole` may be below `begins`."""
    found: FloatArray = np.clip((value - begins) / (whole - begins), 0.0, 1.0)
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
