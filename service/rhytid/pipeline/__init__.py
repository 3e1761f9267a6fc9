"""The paper, one module a section: stretch, redraw, bins, blend. Host side of the kernels."""
