"""Wrinkle graphs made from nothing but a mesh and a seed (section 2.1, after Weiss et al. 2023).

`generate` holds the whole way: pores are scattered, candidate edges join them, walkers wear trails
into the edges, primary lines are laid along them, the strongest edges become lines, and `assembly`
gives these sizes and weights. `seams` copies what reaches over a UV seam.
"""
