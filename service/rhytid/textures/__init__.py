"""Texture files of displacement for the programs that read them: profiles of `rhytid bake`."""
