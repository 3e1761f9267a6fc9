"""The paper, one module a section: stretch, redraw, bins, blend. Host side of the kernels.

A frame's positions become the stretch of triangles (`stretch`, `smooth`). `redraw` draws every
element (`elements`) at its own stretch; `bin_maker` draws them ahead, and `blend` merges those maps
by the stretch of a frame; `convolve` blurs and sharpens the neutral map.
"""
