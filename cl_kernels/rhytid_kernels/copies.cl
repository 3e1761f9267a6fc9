// Copies of wrinkles and pores answer to stretch as their originals do.

// from: (sigma_w, sigma_d) of the originals of the last elements of a UDIM, which are copies.
// first: the first of these.
__kernel void take_scales(__global const float2 *from, int first, __global float2 *scales)
{
    int i = get_global_id(0);
    scales[first + i] = from[i];
}
