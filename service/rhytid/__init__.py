"""Dynamic facial wrinkles (Weiss et al., Eurographics 2024) as an OpenCL compute service."""

__version__ = "0.1.0"
