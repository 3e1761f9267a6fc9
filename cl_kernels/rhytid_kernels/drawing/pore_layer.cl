// Draws precomputed maps of the fast method (section 2.4): the pores at some of the samples, see maps.clh. A
// program of its own, which is the same whatever wrinkles do. Blocks and sums as in redraw.cl.
#include "maps.clh"

// stretches: (sigma_w, sigma_d) of the samples, then as in stretches.clh. maps: see maps_t. least: as in redraw.cl.
__kernel void draw_pore_layer(__global const float2 *centres, __global const float4 *roots,
                              __global const float8 *stretches, __global const int *offsets,
                              __global const int *members, float4 shape_values, float least,
                              float depth, int blocks, int row, int column, int4 maps,
                              __global CODE *codes)
{
    __local float memory[DRAWINGS * APART];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_of_drawings(place, memory);
    int block = place.block;
    for (int k = 0; k < STRETCHES; k++)
        DRAW_PORES(drawing_of(sums, k), shape, members, offsets[block], offsets[block + 1], roots,
                   centres, stretches[k].xy, place.corner, least);
    write_maps(sums, place, shape, depth, stretches, 0.0f, maps, codes);
}
