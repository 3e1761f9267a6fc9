// Copies of wrinkles and pores answer to stretch as their originals do.
#include "line_kinds.clh"

// from: of the originals of some elements of a UDIM that follow one another, which are copies. first:
// the first of these.
__kernel void take_scales(__global const RESPONSE *from, int first, __global RESPONSE *found)
{
    int i = get_global_id(0);
    found[first + i] = from[i];
}
