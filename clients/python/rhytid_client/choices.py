"""What may be chosen by name, for type checkers and editors; the server says what it knows."""

from __future__ import annotations

from typing import Literal

# How displacement is drawn, and how the stretch of a frame is measured and taken.
Method = Literal["neutral", "redraw", "binned", "convolved"]
StretchModel = Literal["tensor", "tension", "uv"]
Sampling = Literal["nearest", "smooth"]
# What a texel has.
Layer = Literal["displacement", "slopes"]
# Files: of tiles and maps, of graphs, of meshes.
TileFormat = Literal["npy", "f16", "exr", "exr16", "png"]
# Of live connections: float32, half floats, 16-bit codes of a scale.
LiveFormat = Literal["f32", "f16", "u16"]
GraphFormat = Literal["safetensors", "obj", "usda"]
MeshFormat = Literal["glb", "ply"]
