// Displacement to codes of a precomputed map: symmetric, 0 is exactly 0. Error at most step / 2
// inside the range. CODE is char or short, CODE_LIMIT its largest code.
#include "vectors.clh"

// codes: of each vector of texels those of MAPS maps, side by side; this is the map `index`.
__kernel void quantise(__global const float *heights, float step, int index, __global CODE *codes)
{
    int i = get_global_id(0);
    int code = convert_int_sat_rte(heights[i] / step);
    codes[place_of(i, index)] = (CODE)clamp(code, -CODE_LIMIT, CODE_LIMIT);
}
