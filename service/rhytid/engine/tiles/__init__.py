"""Tiles and maps: planned, drawn, and shared among callers that ask for the same."""
