"""Benchmarks: what a frame costs, in seconds and in copies of its map."""
