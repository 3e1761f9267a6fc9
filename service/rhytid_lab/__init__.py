"""The demo, benchmarks, the reproduction of the paper, and sample faces, built on rhytid.

The service never imports this package.
"""
