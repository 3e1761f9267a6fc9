// As blend.cl where texels have a stiffness: log stretch is that of the texel's triangle times the
// stiffness of the texel, so no texel is blended like another (Alg. 3, lines 8 to 14). A vector of
// texels per work-item.
#include "texel_blend.clh"

// r at the texels of a vector. first, end: its members. stretches: SIDES x LAYERS per triangle, of
// weights.cl; k: which of them.
inline float16 stretch_of(__global const int2 *first, __global const int2 *end,
                          __global const float *stretches, int k)
{
    float16 r = stretches[first->x * SIDES * LAYERS + k];
    for (first++; first < end; first++)
        r = select(r, (float16)(stretches[first->x * SIDES * LAYERS + k]), lanes_of(first->y));
    return r;
}

// stiffness: of each texel. firsts, members, codes, steps, unit: as in blend.cl. r_max, exponents:
// as in weights.cl. coarse, width: as in blend.cl.
__kernel void blend_stiff(__global const int *firsts, __global const int2 *members,
                          __global const float *stiffness, __global const CODE *codes,
                          __global const float *stretches, __global const float *steps,
                          float r_max, float4 exponents, float unit, int width,
                          __global const float *coarse, __global float *out)
{
    int i = get_global_id(0);
    __global const int2 *first = members + firsts[i], *end = members + firsts[i + 1];
    float16 stiff = vload16(i, stiffness);
    codes += (size_t)i * VECTOR_CODES;
    blend_t blend = {steps, r_max, exponents, unit};
    merge_state_t merged = NOTHING_MERGED;
    for (int n = 0; n < LAYERS; n++) {
        stretches_t s;
        for (int side = 0; side < SIDES; side++)
            s.r[side] = stiff * stretch_of(first, end, stretches, side * LAYERS + n);
        merged = merge_layer(merged, n, s, codes, blend);
    }
    store_heights(merged, unit, coarse, width, i, out);
}
