// A map in displacement to one of the precomputed maps in codes. A vector of texels per work-item.
#include "codes.clh"
#include "vectors.clh"

// per_step: codes for a mesh unit. map: as code_place has it.
__kernel void quantise(__global const float *heights, float per_step, int2 map,
                       __global CODE *codes)
{
    int i = get_global_id(0);
    vstore16(CODES16(vload16(i, heights), per_step), 0,
             codes + code_place(i * WIDTH, map));
}
