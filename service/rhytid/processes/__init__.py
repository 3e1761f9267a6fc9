"""Child processes of a server: the engine of each device, and the decoder of uploads."""
