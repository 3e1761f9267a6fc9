// Where between the precomputed samples each triangle stands (Alg. 3, lines 6 to 10). With nearest
// sampling Alg. 3 up to its line 10 is the same for every texel of a triangle, so it runs here once.
#include "response.clh"

// r of layer n in triangle t: one layer for each orientation bin, the last for the pores. Those from
// ORIENTED on take the mean of both axes: the pores, and a single bin. directions: theta of each bin.
// jacobians: NULL for angles in UV.
inline float layer_stretch(int n, int t, __global const float4 *axes, __global const float2 *logs,
                           __global const float4 *jacobians, __global const float2 *directions)
{
    return n < ORIENTED ? log_stretch_in(t, directions[n], axes, logs, jacobians)
                        : mean_log_stretch(logs[t]);
}

// weights: LAYERS pairs a triangle: its position, from 0 (full compression) to SAMPLES - 1 (full
// stretch), and what the depth is scaled by: 1, or for maps without their depth scale sigma_d of the
// stretch before it is clamped to r_max. exponents: of the depth of wrinkles and of pores; 0 gives 1.
__kernel void sample_weights(__global const float4 *axes, __global const float2 *logs,
                             __global const float4 *jacobians,
                             __global const float2 *directions, float r_max, float2 exponents,
                             __global float2 *weights)
{
    int t = get_global_id(0);
    for (int n = 0; n < LAYERS; n++) {
        float r = layer_stretch(n, t, axes, logs, jacobians, directions);
        float share = clamp(r / r_max, -1.0f, 1.0f);
        float depth = scales_of(r, 0.0f, n < LAYERS - 1 ? exponents.x : exponents.y).depth;
        weights[t * LAYERS + n] = (float2)((share + 1.0f) * (0.5f * (SAMPLES - 1)), depth);
    }
}

// For texels with a stiffness of their own (blend_stiff.cl): r of each layer, LAYERS a triangle.
__kernel void layer_stretches(__global const float4 *axes, __global const float2 *logs,
                              __global const float4 *jacobians,
                              __global const float2 *directions, __global float *stretches)
{
    int t = get_global_id(0);
    for (int n = 0; n < LAYERS; n++)
        stretches[t * LAYERS + n] = layer_stretch(n, t, axes, logs, jacobians, directions);
}
