// Where between the edges of its bin in angle the wrinkle at each texel runs, as codes. A vector of
// texels per work-item.
#include "codes.clh"
#include "vectors.clh"

// up, down: the same map with the depths of its wrinkles scaled by 1 + share delta and by
// 1 - share delta. Of a lone wrinkle their difference is its delta; where wrinkles meet, the mean that
// counts for the height. 0 where there is no height.
// map: as code_place has it.
__kernel void tilt_codes(__global const float *up, __global const float *down, float share,
                         int2 map, __global CODE *codes)
{
    int i = get_global_id(0);
    float16 high = vload16(i, up), low = vload16(i, down), sum = high + low;
    float16 delta = select((high - low) / (sum * share), (float16)(0.0f), sum == 0.0f);
    vstore16(CODES16(clamp(delta, -1.0f, 1.0f), CODE_LIMIT), 0,
             codes + code_place(i * WIDTH, map));
}
