// Redraws every wrinkle and pore of a frame into displacement (section 2.3): a gather, one
// work-group a block of BLOCK x BLOCK texels, no atomics, so any tiling gives the same bits.
#include "draw.clh"

// segments: (a, e) in texels of the UDIM, v up. sizes: (half width in texels, weight).
// centres: pores in texels. metrics: (uu, uv, vv, weight). scales: (sigma_w, sigma_d) of the frame.
// offsets, members: elements of each block, ascending; blocks count from the top left.
// out: displacement in mesh units from block (row, column) on.
__kernel void redraw(__global const float4 *segments, __global const float2 *sizes,
                     __global const float2 *wrinkle_scales, __global const int *wrinkle_offsets,
                     __global const int *wrinkle_members, __global const float2 *centres,
                     __global const float4 *metrics, __global const float2 *pore_scales,
                     __global const int *pore_offsets, __global const int *pore_members,
                     float4 shape_values, float depth, int blocks, int row, int column,
                     __global float *out)
{
    __local float valleys[BLOCK * STRIDE], bulges[BLOCK * STRIDE];
    sums_t sums = {valleys, bulges, get_local_id(0)};
    shape_t shape = {shape_values.x, shape_values.y, shape_values.z, shape_values.w};
    int block_row = row + get_group_id(1), block_column = column + get_group_id(0);
    int block = block_row * blocks + block_column;
    float2 corner = (float2)(block_column, blocks - 1 - block_row) * (float)BLOCK;
    clear_sums(sums);
    for (int k = wrinkle_offsets[block]; k < wrinkle_offsets[block + 1]; k++) {
        int i = wrinkle_members[k];
        float2 scale = wrinkle_scales[i], size = sizes[i];
        float4 s = segments[i];
        draw_wrinkle(sums, s.xy - corner, s.zw, size.x * scale.x, size.y * scale.y, shape);
    }
    for (int k = pore_offsets[block]; k < pore_offsets[block + 1]; k++) {
        int i = pore_members[k];
        float2 scale = pore_scales[i];
        float4 m = metrics[i];
        draw_pore(sums, centres[i] - corner, m.xyz / (scale.x * scale.x), m.w * scale.y, shape);
    }
    int stride = get_num_groups(0) * BLOCK;
    __global float *block_out = out + get_group_id(1) * BLOCK * stride + get_group_id(0) * BLOCK;
    write_block(sums, shape, depth, BOTH_PARTS, block_out, stride);
}
