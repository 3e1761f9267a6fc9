// Sizes of wrinkles as a precomputed map has them at one log stretch: the weights times what the share
// of each wrinkle makes of its depth. A work-item per wrinkle.
#include "shares.clh"

// sizes: half widths at both ends, then weights. shares: at both ends. r: log stretch of the map.
// Relative error below 1e-6.
__kernel void shared_sizes(__global const float4 *sizes, __global const float2 *shares, float r,
                           float depth_exponent, __global float4 *found)
{
    int i = get_global_id(0);
    float4 size = sizes[i];
    size.zw *= SHARED_DEPTH(r, depth_exponent, shares[i]);
    found[i] = size;
}
