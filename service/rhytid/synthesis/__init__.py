"""Wrinkle graphs made from nothing but a mesh and a seed (section 2.1, after Weiss et al. 2023)."""
