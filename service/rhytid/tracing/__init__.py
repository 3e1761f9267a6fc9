"""Traces the relief of a scan or a sculpt: its valley lines and pits become a wrinkle graph,
and what that does not draw stays as a map. `trace.py` is the whole way."""
