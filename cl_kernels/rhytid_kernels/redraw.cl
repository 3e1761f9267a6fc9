// Redraws every wrinkle and pore of a frame into displacement (section 2.3): a gather, each texel
// of a block of BLOCK x BLOCK in one work-group, no atomics, so any tiling gives the same bits.
#include "listed.clh"

// segments: (a, e) in texels of the UDIM, v up. sizes: (half width in texels, weight).
// centres: pores in texels. roots: (xx, xy, yy, weight), see draw_pore. scales: (sigma_w, sigma_d)
// of the frame.
// offsets, members: elements of each block, ascending; blocks count from the top left.
// waves: where WAVY is defined, see draw_wavy_wrinkle; amplitudes in texels.
// even, skews: where SKEWED is defined, see draw_listed; (xx, xy, yy, 0), texels^-1.
// out: displacement in mesh units from block (row, column) on.
__kernel void redraw(__global const float4 *segments, __global const float2 *sizes,
                     __global const float2 *wrinkle_scales, __global const int *wrinkle_offsets,
                     __global const int *wrinkle_members, __global const float2 *centres,
                     __global const float4 *roots, __global const float2 *pore_scales,
                     __global const int *pore_offsets,
                     __global const int *pore_members WAVES SKEWS, float4 shape_values,
                     float depth, int blocks, int row, int column, __global float *out)
{
    __local float memory[2 * ROWS * STRIDE];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_at(place, memory);
    int block = place.block;
    for (int k = wrinkle_offsets[block]; k < wrinkle_offsets[block + 1]; k++) {
        int i = wrinkle_members[k];
        float2 scale = wrinkle_scales[i], size = sizes[i];
        draw_listed(sums, i, place.corner, segments[i], size, scale.x, size.y * scale.y,
                    shape GIVEN_WAVES GIVEN_SKEWS);
    }
    for (int k = pore_offsets[block]; k < pore_offsets[block + 1]; k++) {
        int i = pore_members[k];
        float2 scale = pore_scales[i];
        float4 r = roots[i];
        draw_pore(sums, centres[i] - place.corner, r.xyz / scale.x, r.w * scale.y, shape);
    }
    write_rows(sums, place, shape, depth, BOTH_PARTS, out);
}
