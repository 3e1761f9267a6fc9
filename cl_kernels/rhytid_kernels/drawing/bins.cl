// Draws precomputed maps of the fast method (section 2.4): the wrinkles of one orientation bin at some of the
// samples, and the tilt of the bin, see maps.clh. Blocks and sums as in redraw.cl.
#include "maps.clh"

#include "line.clh"
#include "stretches.clh"

#define LEAN_OF(i) (TILTED ? leaning(segments[i].zw, tilt.xyz) : 0.0f)
#if BENT && defined(WIDE)
#define DRAW_BIN(sums, shape, members, first, end, corner, least)                                  \
    DRAW_SIXTEENS(sums, shape, members, first, end, bins[i] == bin, sizes[i],                      \
                  KEEP_SHARE; lines.lean[count] = LEAN_OF(i), from_corner(lanes, corner),          \
                  stretched_lanes(lanes, stretches[k]), least,                                     \
                  LINE_AT(i, STRETCHED_SIZE(i, stretches[k], LEAN_OF(i)), corner, least))
#else
#define DRAW_BIN(sums, shape, members, first, end, corner, least)                                  \
    for (int k = 0; k < DRAWINGS; k++)                                                             \
        DRAW_EACH_LINE(drawing_of(sums, k), shape, members, first, end, bins[i] == bin,            \
                       LINE_AT(i, STRETCHED_SIZE(i, stretches[k], LEAN_OF(i)), corner, least))
#endif

// stretches: (sigma_w, sigma_d) of the samples, Alg. 1 lines 7 and 8 with their log stretch, the same at
// both ends, see stretches.clh; behind those of the samples the two of the tilt. tilt: (theta, share over
// half a bin, share). maps: see maps_t. least: as in redraw.cl.
__kernel void draw_wrinkle_bin(LINES, SHARES_OF_LINES __global const float8 *stretches,
                               __global const uchar *bins, int bin, float4 tilt,
                               __global const int *offsets, __global const int *members,
                               float4 shape_values, float least, float depth, int blocks, int row,
                               int column, int4 maps, __global CODE *codes)
{
    __local float memory[DRAWINGS * APART];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_of_drawings(place, memory);
    int block = place.block;
    DRAW_BIN(sums, shape, members, offsets[block], offsets[block + 1], place.corner, least);
    write_maps(sums, place, shape, depth, stretches, tilt.w, maps, codes);
}
