// Where between the precomputed samples each triangle stands (Alg. 3, lines 6 to 10). With nearest
// sampling Alg. 3 up to its line 10 is the same for every texel of a triangle, so it runs here once.
#include "response.clh"

// positions: LAYERS floats a triangle, from 0 (full compression) to SAMPLES - 1 (full stretch):
// one for each orientation bin, the last one for the pores. directions: theta of each bin.
// The layers from ORIENTED on take the mean of both axes: the pores, and a single bin.
__kernel void sample_positions(__global const float4 *axes, __global const float2 *logs,
                               __global const float2 *directions, float r_max,
                               __global float *positions)
{
    int t = get_global_id(0);
    for (int n = 0; n < LAYERS; n++) {
        float r = n < ORIENTED ? log_stretch_across(directions[n], axes[t], logs[t])
                               : mean_log_stretch(logs[t]);
        float share = clamp(r / r_max, -1.0f, 1.0f);
        positions[t * LAYERS + n] = (share + 1.0f) * (0.5f * (SAMPLES - 1));
    }
}
