// Width and depth scales of every wrinkle and pore of a frame (Alg. 1 and 2).
#include "response.clh"

// One work-item a wrinkle. triangle: what its centre samples. scales: (sigma_w, sigma_d).
__kernel void respond_wrinkles(__global const float4 *segments, __global const int *triangle,
                               __global const float4 *axes, __global const float2 *logs,
                               float width_exponent, float depth_exponent, __global float2 *scales)
{
    int i = get_global_id(0);
    int t = triangle[i];
    float4 s = segments[i];
    float r = log_stretch_across(normalize(s.zw), axes[t], logs[t]);
    scales_t found = scales_of(r, width_exponent, depth_exponent);
    scales[i] = (float2)(found.width, found.depth);
}

// One work-item a pore.
__kernel void respond_pores(__global const int *triangle, __global const float2 *logs,
                            float width_exponent, float depth_exponent, __global float2 *scales)
{
    int i = get_global_id(0);
    float r = mean_log_stretch(logs[triangle[i]]);
    scales_t found = scales_of(r, width_exponent, depth_exponent);
    scales[i] = (float2)(found.width, found.depth);
}
