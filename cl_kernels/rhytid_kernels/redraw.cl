// Redraws every wrinkle and pore of a frame into displacement (section 2.3): a gather, each texel
// of a block of BLOCK x BLOCK in one work-group, no atomics, so any tiling gives the same bits.
#include "line.clh"

// LINES, in texels of the UDIM, v up; sizes (half width, weight), see line.clh.
// wrinkle_scales: (sigma_w, sigma_d) of the frame, with BENT sigma_w at both ends, then sigma_d.
// centres: pores in texels. roots: (xx, xy, yy, weight), see draw_pore. pore_scales: (sigma_w,
// sigma_d).
// offsets, members: elements of each block, ascending; blocks count from the top left.
// least: half width in texels that nothing is drawn narrower than, 0 for none.
// out: displacement in mesh units from block (row, column) on.
__kernel void redraw(LINES, __global const SIZES *wrinkle_scales,
                     __global const int *wrinkle_offsets, __global const int *wrinkle_members,
                     __global const float2 *centres, __global const float4 *roots,
                     __global const float2 *pore_scales, __global const int *pore_offsets,
                     __global const int *pore_members, float4 shape_values, float least,
                     float depth, int blocks, int row, int column, __global float *out)
{
    __local float memory[2 * ROWS * STRIDE];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_at(place, memory);
    int block = place.block;
    for (int k = wrinkle_offsets[block]; k < wrinkle_offsets[block + 1]; k++) {
        int i = wrinkle_members[k];
        line_t line = LINE_AT(i, sizes[i] * wrinkle_scales[i], place.corner, least);
        draw_line(sums, line, shape);
    }
    for (int k = pore_offsets[block]; k < pore_offsets[block + 1]; k++) {
        int i = pore_members[k];
        float2 scale = pore_scales[i];
        float4 r = roots[i];
        float4 pore = at_least_pore(r.xyz / scale.x, r.w * scale.y, least);
        draw_pore(sums, centres[i] - place.corner, pore.xyz, pore.w, shape);
    }
    write_rows(sums, place, shape, depth, BOTH_PARTS, out);
}
