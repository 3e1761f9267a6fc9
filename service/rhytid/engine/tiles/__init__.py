"""Tiles and maps: named, shared among those who ask for the same, drawn."""
