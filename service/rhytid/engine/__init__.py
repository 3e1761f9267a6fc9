"""What the API and the command line call: assets on a device, a frame in, tiles out."""
