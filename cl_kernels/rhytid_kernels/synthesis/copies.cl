// Copies of wrinkles and pores answer to stretch as their originals do.

// What there is of each: (sigma_w, sigma_d), or of wrinkles that bend r, see response.clh.
#ifdef BENT
#define FOUND float
#else
#define FOUND float2
#endif

// from: of the originals of some elements of a UDIM that follow one another, which are copies. first:
// the first of these.
__kernel void take_scales(__global const FOUND *from, int first, __global FOUND *found)
{
    int i = get_global_id(0);
    found[first + i] = from[i];
}
