// As blend.cl where texels have a stiffness: log stretch is that of the texel's triangle times the
// stiffness of the texel, so no texel is blended like another (Alg. 3, lines 8 to 14). A vector of
// texels a work-item.
#include "texel_blend.clh"

// r of layer n at the texels of a vector. first, end: its members. stretches: LAYERS a triangle, of
// weights.cl.
inline float16 stretch_of(__global const int2 *first, __global const int2 *end,
                          __global const float *stretches, int n)
{
    float16 r = stretches[first->x * LAYERS + n];
    for (first++; first < end; first++)
        r = select(r, (float16)(stretches[first->x * LAYERS + n]), lanes_of(first->y));
    return r;
}

// stiffness: of each texel. firsts, members, codes, steps, merge: as in blend.cl. r_max, exponents:
// as in weights.cl.
__kernel void blend_stiff(__global const int *firsts, __global const int2 *members,
                          __global const float *stiffness, __global const CODE *codes,
                          __global const float *stretches, __global const float *steps,
                          float r_max, float2 exponents, float2 merge, __global float *out)
{
    int i = get_global_id(0), at = i * WIDTH;
    __global const int2 *first = members + firsts[i], *end = members + firsts[i + 1];
    float16 stiff = vload16(0, stiffness + at);
    codes += (size_t)i * VECTOR_CODES;
    blend_t blend = {steps, r_max, exponents, merge};
    merged_t sum = NOTHING_MERGED;
    for (int n = 0; n < LAYERS; n++)
        merge_layer(&sum, n, stiff * stretch_of(first, end, stretches, n), codes, blend);
    vstore16(merged(sum, blend), 0, out + at);
}
