"""Work on meshes without a device: checking them, carrying graphs from one to another."""
