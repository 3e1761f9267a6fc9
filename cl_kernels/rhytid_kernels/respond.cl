// Width and depth scales of every wrinkle and pore of a frame (Alg. 1 and 2).
#include "response.clh"

// One work-item a wrinkle. triangle: what its centre samples. jacobians: NULL for angles in UV.
// stiffness: of each wrinkle, or NULL. scales: (sigma_w, sigma_d).
__kernel void respond_wrinkles(__global const float4 *segments, __global const int *triangle,
                               __global const float4 *axes, __global const float2 *logs,
                               __global const float4 *jacobians,
                               __global const float *stiffness, float width_exponent,
                               float depth_exponent, __global float2 *scales)
{
    int i = get_global_id(0);
    float4 s = segments[i];
    float r = log_stretch_in(triangle[i], normalize(s.zw), axes, logs, jacobians);
    scales_t found = scales_of(stiffened(r, stiffness, i), width_exponent, depth_exponent);
    scales[i] = (float2)(found.width, found.depth);
}

// One work-item a pore.
__kernel void respond_pores(__global const int *triangle, __global const float2 *logs,
                            __global const float *stiffness, float width_exponent,
                            float depth_exponent, __global float2 *scales)
{
    int i = get_global_id(0);
    float r = mean_log_stretch(logs[triangle[i]]);
    scales_t found = scales_of(stiffened(r, stiffness, i), width_exponent, depth_exponent);
    scales[i] = (float2)(found.width, found.depth);
}
