// Draws one precomputed map of the fast method (section 2.4): the wrinkles of one orientation bin,
// or the pores, all at one stretch. Blocks and sums as in redraw.cl.
#include "draw.clh"

#define BLOCK_OF_GROUP                                                                             \
    __local float valleys[BLOCK * STRIDE], bulges[BLOCK * STRIDE];                                 \
    sums_t sums = {valleys, bulges, get_local_id(0)};                                              \
    shape_t shape = {shape_values.x, shape_values.y, shape_values.z, shape_values.w};              \
    int block_row = row + get_group_id(1), block_column = column + get_group_id(0);                \
    int block = block_row * blocks + block_column;                                                 \
    float2 corner = (float2)(block_column, blocks - 1 - block_row) * (float)BLOCK;                 \
    int stride = get_num_groups(0) * BLOCK;                                                        \
    __global float *block_out = out + get_group_id(1) * BLOCK * stride + get_group_id(0) * BLOCK;  \
    clear_sums(sums);

// scale: (sigma_w, sigma_d) of the sample, Alg. 1 lines 7 and 8 with its log stretch. part: valleys
// and bulges together, or one of them for maps that are merged by the mellow-max.
__kernel void draw_wrinkle_bin(__global const float4 *segments, __global const float2 *sizes,
                               __global const uchar *bins, int bin, float2 scale, int part,
                               __global const int *offsets, __global const int *members,
                               float4 shape_values, float depth, int blocks, int row, int column,
                               __global float *out)
{
    BLOCK_OF_GROUP
    for (int k = offsets[block]; k < offsets[block + 1]; k++) {
        int i = members[k];
        float4 s = segments[i];
        if (bins[i] == bin)
            draw_wrinkle(sums, s.xy - corner, s.zw, sizes[i].x * scale.x, sizes[i].y * scale.y, shape);
    }
    write_block(sums, shape, depth, part, block_out, stride);
}

__kernel void draw_pore_layer(__global const float2 *centres, __global const float4 *metrics,
                              float2 scale, int part, __global const int *offsets,
                              __global const int *members, float4 shape_values, float depth,
                              int blocks, int row, int column, __global float *out)
{
    BLOCK_OF_GROUP
    for (int k = offsets[block]; k < offsets[block + 1]; k++) {
        int i = members[k];
        float4 m = metrics[i];
        draw_pore(sums, centres[i] - corner, m.xyz / (scale.x * scale.x), m.w * scale.y, shape);
    }
    write_block(sums, shape, depth, part, block_out, stride);
}
