"""Facts: what a mesh, a wrinkle graph, a frame, a tile and a setting are. numpy only."""
