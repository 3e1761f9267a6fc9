// Redraws every wrinkle and pore of a frame into displacement (section 2.3): a gather, each texel
// of a block of BLOCK x BLOCK in one work-group, no atomics, so any tiling gives the same bits.
#include "ahead.clh"

#define ASK_FOR_LINE(i) ask_for_line(i, segments, sizes, slopes, wrinkle_scales)
#include "line.clh"
#ifdef RAISED
#include "spline.clh"

// Asks for the samples of the broad layer that the rows of a work-group are brought up from: what lies rows
// apart no processor sees ahead, and lines are drawn meanwhile.
inline void ask_for_samples(sums_t sums, place_t place, __global const float *coarse)
{
    const int width = -place.above, side = width / COARSER + 4;
    const int at = place.at + (sums.low + ROWS - 1) * place.above;
    coarse = samples_of(coarse, side, at % width, at / width);
    for (int row = 0; row < ROWS / COARSER + 4; row++)
        for (int x = 0; x < BLOCK / COARSER + 4; x += CACHE_LINE / sizeof(float))
            SOON_ALONE(coarse + row * side + x);
}

// As write_rows, with the broad layer of the square added, see cushion.cl.
inline void write_raised_rows(sums_t sums, place_t place, shape_t shape, float depth,
                              __global const float *coarse, __global float *out)
{
    const int width = -place.above, side = width / COARSER + 4;
    for (int y = first_owned(sums, sums.low); y < sums.low + ROWS; y += ITEMS) {
        int at = place.at + y * place.above, row = at / width, column = at % width;
        for (int x = 0; x < BLOCK; x += LANES)
            vstore8(depth * heights_at(sums, x, y, shape, WHOLE) +
                        brought_up(coarse, side, column + x, row),
                    0, out + at + x);
    }
}
#define COARSE_MAP __global const float *coarse,
#define ASK_FOR_SAMPLES(sums, place) ask_for_samples(sums, place, coarse)
#define WRITE_ROWS(sums, place, shape, depth, out)                                                 \
    write_raised_rows(sums, place, shape, depth, coarse, out)
#else
#define COARSE_MAP
#define ASK_FOR_SAMPLES(sums, place)
#define WRITE_ROWS(sums, place, shape, depth, out)                                                 \
    write_rows(sums, place, shape, depth, WHOLE, out)
#endif

// See ASK_FOR_LINE of arcs.clh.
inline void ask_for_line(int i, __global const float4 *segments, __global const SIZES *sizes,
                         __global const float2 *slopes, __global const SIZES *scales)
{
    SOON_ALONE(segments + i);
    SOON_ALONE(sizes + i);
    SOON_ALONE(slopes + i);
    SOON_ALONE(scales + i);
}

// LINES, in texels of the UDIM, v up; sizes (half width, weight), see line.clh.
// wrinkle_scales: (sigma_w, sigma_d) of the frame, with BENT sigma_w at both ends, then sigma_d.
// centres: pores in texels. roots: (xx, xy, yy, weight), see draw_pore. pore_scales: (sigma_w,
// sigma_d).
// offsets, members: elements of each block, ascending; blocks count from the top left.
// least: half width in texels that nothing is drawn narrower than, 0 for none.
// coarse: where RAISED is defined, the broad layer around the square, mesh units.
// out: displacement in mesh units from block (row, column) on.
__kernel void redraw(LINES, __global const SIZES *wrinkle_scales,
                     __global const int *wrinkle_offsets, __global const int *wrinkle_members,
                     __global const float2 *centres, __global const float4 *roots,
                     __global const float2 *pore_scales, __global const int *pore_offsets,
                     __global const int *pore_members, float4 shape_values, float least,
                     float depth, int blocks, int row, int column, COARSE_MAP __global float *out)
{
    __local float memory[SUMS_OF_BOTH];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_at(place, memory);
    int block = place.block;
    ASK_FOR_SAMPLES(sums, place);
    DRAW_LINES(sums, shape, wrinkle_members, wrinkle_offsets[block], wrinkle_offsets[block + 1], true,
               sizes[i] * wrinkle_scales[i], place.corner, least);
    DRAW_PORES(sums, shape, pore_members, pore_offsets[block], pore_offsets[block + 1],
               roots, centres, pore_scales[i], place.corner, least);
    WRITE_ROWS(sums, place, shape, depth, out);
}
