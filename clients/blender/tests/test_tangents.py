"""Normal maps of `rhytid bake`, shaded with Blender's tangents, which are MikkTSpace's own code."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray
from scenes import add

from conftest import command

Floats = NDArray[np.float64]
SIDE = 512


@dataclass(frozen=True)
class Posed:
    """Triangles (F, 3, 3) of a frame, their UV (F, 3, 2), and Blender's normals and tangents
    (F, 3, 3) of corners with the signs (F, 3) of the bitangents."""

    corners: Floats
    uv: Floats
    normals: Floats
    tangents: Floats
    signs: Floats


def posed(positions: Floats, faces: NDArray[np.int32], uv: Floats) -> Posed:
    """What Blender makes of a smooth mesh."""
    mesh = add("face", positions, faces, uv).data
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), np.bool_))
    mesh.update()
    mesh.calc_tangents()
    vectors = {name: np.empty(len(mesh.loops) * 3, np.float32) for name in ("normal", "tangent")}
    for name, values in vectors.items():
        mesh.loops.foreach_get(name, values)
    signs = np.empty(len(mesh.loops), np.float32)
    mesh.loops.foreach_get("bitangent_sign", signs)
    normals, tangents = (values.reshape(-1, 3, 3).astype(float) for values in vectors.values())
    return Posed(positions[faces].astype(float), uv, normals, tangents, signs.reshape(-1, 3))


def folded() -> tuple[Floats, NDArray[np.int32], Floats]:
    """A curved sheet: positions (V, 3), faces (F, 3), UV (F, 3, 2). The UV of its right half are
    mirrored and stand apart, so that there is a seam with both signs."""
    cells = 12
    line = np.linspace(0.0, 1.0, cells + 1)
    u, v = (part.reshape(-1) for part in np.meshgrid(line, line))
    positions = np.stack([10 * u + 3 * v, 12 * v, 6 * u * u - 4 * v * v + 2 * u * v], axis=1)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1, 1)
    steps = np.array([[0, 1, cells + 2], [0, cells + 2, cells + 1]])
    faces = (corner[:, None] + steps).reshape(-1, 3).astype(np.int32)
    uv = np.stack([0.9 * u + 0.02, 0.9 * v + 0.05], axis=1)[faces]
    right = u[faces].mean(axis=1) > 0.5
    uv[right, :, 0] = 1.45 - uv[right, :, 0]
    return positions, faces, uv


def face() -> tuple[Floats, NDArray[np.int32], Floats, Floats]:
    """The real face and its smile."""
    with np.load(Path(os.environ["RHYTID_FACE_DATA"]) / "ict_face" / "face.npz") as stored:
        names = stored["expr_names"].tolist()
        sides = [names.index(f"mouthSmile_{side}") for side in "LR"]
        positions, uv = stored["positions"], stored["uv"][stored["face_uv"]].astype(float)
        return positions, stored["faces"], uv, positions + stored["expr_deltas"][sides].sum(axis=0)


def baked(
    folder: Path, positions: Floats, faces: NDArray[np.int32], uv: Floats, frame: Floats
) -> tuple[Floats, Floats]:
    """Heights (R, R) and the normal map (R, R, 3) of a frame, by the command line."""
    mesh = folder / "face.npz"
    numbers = np.arange(3 * len(faces)).reshape(-1, 3)
    np.savez(
        mesh, positions=positions, faces=faces, uv=uv.reshape(-1, 2), face_uv=numbers,
        frames=frame[None],
    )  # fmt: skip
    options = ["--resolution", str(SIDE), "--wrinkles", "4000", "--lines", "level"]
    profiles = ["--profile", "float", "normal-gl", "--out", str(folder / "maps"), "--quiet"]
    subprocess.run(
        [*command()[:-1], "bake", "--mesh", str(mesh), *options, *profiles],
        check=True,
        capture_output=True,
    )
    file = OpenEXR.File(str(folder / "maps/face.1001.0001.exr"), separate_channels=True)
    heights = file.channels()["Y"].pixels.astype(float)
    return heights, sixteen_bits(folder / "maps/face.normal-gl.1001.0001.png")


def sixteen_bits(path: Path) -> Floats:
    """(R, R, 3) vectors of a PNG, read by Blender: Pillow would cut them to 8 bits."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    pixels = np.empty(SIDE * SIDE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(SIDE, SIDE, 4)[::-1, :, :3].astype(float) * 2 - 1


def texels_of(mesh: Posed) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Triangles (K,) that hold the centre of the texel (K, 2) in their middle, row and column, and
    of its four neighbours; and the weights (K, 3) of the corners there."""
    middle = mesh.uv.mean(axis=1)
    column, row = (middle[:, 0] * SIDE).astype(int), ((1 - middle[:, 1]) * SIDE).astype(int)
    centre = np.stack([(column + 0.5) / SIDE, 1 - (row + 0.5) / SIDE], axis=1)
    to_uv = np.stack([mesh.uv[:, 1] - mesh.uv[:, 0], mesh.uv[:, 2] - mesh.uv[:, 0]], axis=2)
    held = np.ones(len(centre), np.bool_)
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1), (0, 0)):
        away = centre + np.array(step) / SIDE - mesh.uv[:, 0]
        last = np.linalg.solve(to_uv, away[..., None])[..., 0]
        weights = np.concatenate([1 - last.sum(axis=1, keepdims=True), last], axis=1)
        held &= weights.min(axis=1) > 0
    return np.flatnonzero(held), np.stack([row, column], axis=1)[held], weights[held]


def wanted(
    mesh: Posed, heights: Floats, found: NDArray, texels: NDArray, weights: Floats
) -> Floats:
    """(K, 3) normals of the surface moved by its heights: n - g, g the gradient on the triangle,
    turned as the normal of the triangle has to be turned to n."""
    row, column = texels.T
    du = (heights[row, column + 1] - heights[row, column - 1]) * SIDE / 2
    dv = (heights[row - 1, column] - heights[row + 1, column]) * SIDE / 2
    edges = mesh.corners[found, 1:] - mesh.corners[found, :1]
    across = mesh.uv[found, 1:] - mesh.uv[found, :1]
    rises = np.einsum("kei,ki->ke", across, np.stack([du, dv], axis=1))
    flat = unit(np.cross(edges[:, 0], edges[:, 1]))
    system = np.concatenate([edges, flat[:, None]], axis=1)
    slope = np.linalg.solve(system, np.pad(rises, [(0, 0), (0, 1)])[..., None])[..., 0]
    normal = unit(np.einsum("kc,kcx->kx", weights, mesh.normals[found]))
    axis, cosine = np.cross(flat, normal), np.sum(flat * normal, axis=1, keepdims=True)
    turned = slope * cosine + np.cross(axis, slope)
    turned += axis * np.sum(axis * slope, axis=1, keepdims=True) / (1 + cosine)
    return unit(normal - turned)


def shaded(mesh: Posed, map: Floats, found: NDArray, texels: NDArray, weights: Floats) -> Floats:
    """(K, 3) normals as MikkTSpace has them made: of what is interpolated, not normalised."""
    normal = np.einsum("kc,kcx->kx", weights, mesh.normals[found])
    tangent = np.einsum("kc,kcx->kx", weights, mesh.tangents[found])
    bitangent = mesh.signs[found, :1] * np.cross(normal, tangent)
    x, y, z = map[tuple(texels.T)].T[..., None]
    return unit(x * tangent + y * bitangent + z * normal)


def unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def degrees(a: Floats, b: Floats) -> Floats:
    return np.degrees(2 * np.arcsin(np.linalg.norm(a - b, axis=-1) / 2))


def errors(
    folder: Path, positions: Floats, faces: NDArray[np.int32], uv: Floats, frame: Floats
) -> tuple[Floats, Floats]:
    """Degrees between what Blender shades and the true normals, and of the slopes themselves."""
    heights, map = baked(folder, positions, faces, uv, frame)
    mesh = posed(frame, faces, uv)
    found = texels_of(mesh)
    true = wanted(mesh, heights, *found)
    assert len(true) > 100
    normal = unit(np.einsum("kc,kcx->kx", found[2], mesh.normals[found[0]]))
    return degrees(shaded(mesh, map, *found), true), degrees(true, normal)


def test_seams_and_mirrored_islands_are_shaded_as_displaced(
    blender: bpy.types.Scene, tmp_path: Path
) -> None:
    positions, faces, uv = folded()
    frame = positions * (1.0, 0.8, 1.3)
    error, slopes = errors(tmp_path, positions, faces, uv, frame)
    assert slopes.max() > 10
    assert error.max() < 0.02


@pytest.mark.face
def test_a_smile_is_shaded_as_displaced(blender: bpy.types.Scene, tmp_path: Path) -> None:
    """In tiny triangles normals of corners are far apart, and how slopes are turned with them is a
    choice."""
    positions, faces, uv, frame = face()
    error, slopes = errors(tmp_path, positions, faces, uv, frame)
    assert slopes.max() > 10
    assert np.percentile(error, 99) < 0.1
    assert error.max() < 1.5
