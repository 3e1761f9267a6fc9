// A map in displacement to one of the precomputed maps in codes. A vector of texels per work-item.
#include "codes.clh"
#include "vectors.clh"

// per_step: codes for a mesh unit. codes: of each vector those of MAPS maps, side by side; this is the
// map `index`.
__kernel void quantise(__global const float *heights, float per_step, int index,
                       __global CODE *codes)
{
    int i = get_global_id(0);
    vstore16(CODES16(VECTOR_OF(float16, heights, i), per_step), 0,
             codes + place_of(i * WIDTH, index));
}
