"""Bytes to facts and back: meshes, frames, wrinkle graphs, displacement tiles."""
