"""The calls of the API and the command line: assets on a device, a frame in, tiles out."""
