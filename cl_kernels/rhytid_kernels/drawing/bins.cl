// Draws one precomputed map of the fast method (section 2.4): the wrinkles of one orientation bin,
// or the pores, all at one stretch. Blocks and sums as in redraw.cl.
#include "line.clh"
#include "shared_sizes.clh"

// What a map becomes: displacement in mesh units, row by row, or where CODE is defined codes, per_step
// of them for a mesh unit. map: as code_place has it.
#ifdef CODE
#include "codes.clh"
#include "vectors.clh"
#define OUT float per_step, int2 map, __global CODE *codes
#define WRITE(sums, place, shape, depth, part)                                                     \
    write_codes(sums, place, shape, depth * per_step, part, map, codes)

inline void write_codes(sums_t sums, place_t place, shape_t shape, float scale, int part, int2 map,
                        __global CODE *codes)
{
    for (int y = first_owned(sums, sums.low); y < sums.low + ROWS; y += ITEMS)
        for (int x = 0; x < BLOCK; x += LANES) {
            size_t at = code_place(place.at + y * place.above + x, map);
            vstore8(CODES8(heights_at(sums, x, y, shape, part), scale), 0, codes + at);
        }
}
#else
#define OUT __global float *out
#define WRITE(sums, place, shape, depth, part) write_rows(sums, place, shape, depth, part, out)
#endif

// scale: (sigma_w, sigma_d) of the sample, Alg. 1 lines 7 and 8 with its log stretch, the same at both
// ends. part: valleys and bulges together, or one of them for maps that are merged by the mellow-max.
// least: as in redraw.cl.
__kernel void draw_wrinkle_bin(LINES, SHARES __global const uchar *bins, int bin, float2 scale, int part,
                               __global const int *offsets, __global const int *members, float4 shape_values, float least,
                               float depth, int blocks, int row, int column, OUT)
{
    __local float memory[2 * SUMS];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_at(place, memory);
    int block = place.block;
    DRAW_LINES(sums, shape, members, offsets[block], offsets[block + 1], bins[i] == bin,
               SIZES_OF(i) * SCALES(scale), place.corner, least);
    WRITE(sums, place, shape, depth, part);
}

__kernel void draw_pore_layer(__global const float2 *centres, __global const float4 *roots,
                              float2 scale, int part, __global const int *offsets,
                              __global const int *members, float4 shape_values, float least,
                              float depth, int blocks, int row, int column, OUT)
{
    __local float memory[2 * SUMS];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_at(place, memory);
    int block = place.block;
    DRAW_PORES(sums, shape, members, offsets[block], offsets[block + 1],
               scaled_pore(roots[i], scale, least), centres[i] - place.corner);
    WRITE(sums, place, shape, depth, part);
}
