"""Edges between pores that may become wrinkles."""
