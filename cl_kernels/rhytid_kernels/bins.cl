// Draws one precomputed map of the fast method (section 2.4): the wrinkles of one orientation bin,
// or the pores, all at one stretch. Blocks and sums as in redraw.cl.
#include "draw.clh"
#include "wave.clh"

// Where in its bin a wrinkle along `extent` runs: its angle to theta, mod pi, times a factor.
// tilt: (theta, factor).
inline float leaning(float2 extent, float3 tilt)
{
    float along = dot(extent, tilt.xy), across = extent.x * tilt.y - extent.y * tilt.x;
    return atan(across / along) * tilt.z;
}

// scale: (sigma_w, sigma_d) of the sample, Alg. 1 lines 7 and 8 with its log stretch. part: valleys
// and bulges together, or one of them for maps that are merged by the mellow-max. tilt: depths are
// scaled by 1 + leaning, for the maps that tilts are made from; else its factor is 0. waves: as in
// redraw.cl.
__kernel void draw_wrinkle_bin(__global const float4 *segments, __global const float2 *sizes,
                               __global const uchar *bins, int bin, float2 scale, int part,
                               float4 tilt, __global const int *offsets,
                               __global const int *members,
#ifdef WAVY
                               __global const float4 *waves,
#endif
                               float4 shape_values, float depth, int blocks, int row, int column,
                               __global float *out)
{
    __local float memory[2 * ROWS * STRIDE];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column, out);
    sums_t sums = sums_at(place, memory);
    int block = place.block;
    for (int k = offsets[block]; k < offsets[block + 1]; k++) {
        int i = members[k];
        float4 s = segments[i];
        if (bins[i] != bin)
            continue;
        float half_width = sizes[i].x * scale.x;
        float amplitude = sizes[i].y * scale.y * (1.0f + leaning(s.zw, tilt.xyz));
#ifdef WAVY
        draw_wavy_wrinkle(sums, s.xy - place.corner, s.zw, half_width, amplitude, waves[i], shape);
#else
        draw_wrinkle(sums, s.xy - place.corner, s.zw, half_width, amplitude, shape);
#endif
    }
    write_rows(sums, place, shape, depth, part);
}

__kernel void draw_pore_layer(__global const float2 *centres, __global const float4 *roots,
                              float2 scale, int part, __global const int *offsets,
                              __global const int *members, float4 shape_values, float depth,
                              int blocks, int row, int column, __global float *out)
{
    __local float memory[2 * ROWS * STRIDE];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column, out);
    sums_t sums = sums_at(place, memory);
    int block = place.block;
    for (int k = offsets[block]; k < offsets[block + 1]; k++) {
        int i = members[k];
        float4 r = roots[i];
        draw_pore(sums, centres[i] - place.corner, r.xyz / scale.x, r.w * scale.y, shape);
    }
    write_rows(sums, place, shape, depth, part);
}
