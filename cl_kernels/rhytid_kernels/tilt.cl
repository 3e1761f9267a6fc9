// Where between the edges of its bin in angle the wrinkle at each texel runs, as codes.
#include "vectors.clh"

// up, down: the same map with the depths of its wrinkles scaled by 1 + share delta and by
// 1 - share delta. Of a lone wrinkle their difference is its delta; where wrinkles meet, the mean that
// counts for the height. 0 where there is no height.
// codes, index: as in quantise.cl.
__kernel void tilt_codes(__global const float *up, __global const float *down, float share,
                         int index, __global CODE *codes)
{
    int i = get_global_id(0);
    float sum = up[i] + down[i];
    float delta = sum == 0.0f ? 0.0f : (up[i] - down[i]) / (sum * share);
    codes[place_of(i, index)] = (CODE)convert_int_rte(clamp(delta, -1.0f, 1.0f) * CODE_LIMIT);
}
