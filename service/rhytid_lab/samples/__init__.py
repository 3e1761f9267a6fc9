"""A procedural face and a sphere that deform, for the demo, the figures and the tests."""
