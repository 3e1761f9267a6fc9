"""What is built on rhytid: the demo, benchmarks, the reproduction of the paper, sample faces.

The service never imports this package.
"""
