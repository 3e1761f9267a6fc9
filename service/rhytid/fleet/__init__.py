"""A service on many devices and machines: engines as replicas of Ray Serve, behind the same API."""
