// As blend.cl with smooth sampling: every texel has a stretch of its own (Alg. 3, lines 2 to 14).
// A vector of texels per work-item.
#include "texel_blend.clh"

#define REAL float16
#define MASK int16
#define ANY(mask) any(mask)
#include "smooth.clh"
#include "surface.clh"
#include "texel_fields.clh"

// firsts, members, codes, steps, unit: as in blend.cl, of a tile of `width` texels per side, from texel
// (row, column) of a level of `side` texels on. directions, r_max, exponents: as in weights.cl.
// neutral: fields of the neutral for angles on the surface, NULL for angles in UV. stiffness: of each
// texel, or NULL. coarse: as in blend.cl.
__kernel void blend_smooth(__global const int *firsts, __global const int2 *members,
                           __global const CODE *codes, __global const float *steps,
                           __global const float2 *directions, float r_max, float4 exponents,
                           float unit, int width, int side, int row, int column,
                           __global const float *corners, __global const int *vertices,
                           __global const float8 *fields, int none, float limit,
                           __global const float8 *neutral, __global const float *stiffness,
                           __global const float *coarse, __global float *out)
{
    int i = get_global_id(0);
    float16 x = (columns(i, width) + (column + 0.5f)) / side;
    float16 y = (side - row - 0.5f - rows(i, width)) / side;
    __global const int2 *first = members + firsts[i], *end = members + firsts[i + 1];
    principal_t p = principal(fields_at(first, end, x, y, corners, vertices, fields, none), limit);
    form_t metric = unstretched().metric;
    if (neutral)
        metric = fields_at(first, end, x, y, corners, vertices, neutral, none).metric;
    float16 stiff = stiffness ? vload16(i, stiffness) : (float16)(1.0f);
    codes += (size_t)i * VECTOR_CODES;
    blend_t blend = {steps, r_max, exponents, unit};
    merge_state_t merged = NOTHING_MERGED;
    for (int n = 0; n < LAYERS; n++) {
        stretches_t s;
        for (int side = 0; side < SIDES; side++) {
            float16 r = 0.5f * (p.log1 + p.log2);
            float2 theta = directions[side * ORIENTED + n];
            if (n < ORIENTED)
                r = neutral ? across_surface(theta, p, metric) : across(theta, p);
            s.r[side] = stiff * r;
        }
        merged = merge_layer(merged, n, s, codes, blend);
    }
    store_heights(merged, unit, coarse, width, i, out);
}
