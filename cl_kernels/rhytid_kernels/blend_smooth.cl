// As blend.cl with smooth sampling: every texel has a stretch of its own (Alg. 3, lines 2 to 14).
// A vector of texels a work-item.
#include "texel_blend.clh"

#define REAL float16
#define MASK int16
#define ANY(mask) any(mask)
#include "smooth.clh"
#include "surface.clh"

// Places of texels at, at + 1, ... of a tile of `width` texels a side, a power of two.
inline float16 columns(int at, int width)
{
    int16 lane = (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    return convert_float16((at + lane) & (width - 1));
}

inline float16 rows(int at, int width)
{
    int16 lane = (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    return convert_float16((at + lane) / width);
}

inline form_t chosen(form_t one, form_t other, int16 second)
{
    form_t form = {select(one.uu, other.uu, second), select(one.uv, other.uv, second),
                   select(one.vv, other.vv, second)};
    return form;
}

// The fields at the texels of a vector, once for each triangle among them. first, end: its members.
inline field_t fields_at(__global const int2 *first, __global const int2 *end, float16 x, float16 y,
                         __global const float *corners, __global const int *vertices,
                         __global const float8 *fields, int none)
{
    int16 own = lanes_of(first->y);
    field_t found = field_at(first->x, own, x, y, corners, vertices, fields, none);
    for (first++; first < end; first++) {
        own = lanes_of(first->y);
        field_t other = field_at(first->x, own, x, y, corners, vertices, fields, none);
        found.metric = chosen(found.metric, other.metric, own);
        found.log_stretch = chosen(found.log_stretch, other.log_stretch, own);
    }
    return found;
}

// firsts, members, codes, steps, unit: as in blend.cl, of a tile of `width` texels a side, from texel
// (row, column) of a level of `side` texels on. directions, r_max, exponents: as in weights.cl.
// neutral: fields of the neutral for angles on the surface, NULL for angles in UV. stiffness: of each
// texel, or NULL.
__kernel void blend_smooth(__global const int *firsts, __global const int2 *members,
                           __global const CODE *codes, __global const float *steps,
                           __global const float2 *directions, float r_max, float4 exponents,
                           float unit, int width, int side, int row, int column,
                           __global const float *corners, __global const int *vertices,
                           __global const float8 *fields, int none, float limit,
                           __global const float8 *neutral, __global const float *stiffness,
                           __global float *out)
{
    int i = get_global_id(0), at = i * WIDTH;
    float16 x = (columns(at, width) + (column + 0.5f)) / side;
    float16 y = (side - row - 0.5f - rows(at, width)) / side;
    __global const int2 *first = members + firsts[i], *end = members + firsts[i + 1];
    principal_t p = principal(fields_at(first, end, x, y, corners, vertices, fields, none), limit);
    form_t metric = unstretched().metric;
    if (neutral)
        metric = fields_at(first, end, x, y, corners, vertices, neutral, none).metric;
    float16 stiff = stiffness ? vload16(0, stiffness + at) : (float16)(1.0f);
    codes += (size_t)i * VECTOR_CODES;
    blend_t blend = {steps, r_max, exponents, unit};
    met_t met = NONE_MET;
    for (int n = 0; n < LAYERS; n++) {
        stretches_t s;
        for (int side = 0; side < SIDES; side++) {
            float16 r = 0.5f * (p.log1 + p.log2);
            float2 theta = directions[side * ORIENTED + n];
            if (n < ORIENTED)
                r = neutral ? across_surface(theta, p, metric) : across(theta, p);
            s.r[side] = stiff * r;
        }
        met = meet_layer(met, n, s, codes, blend);
    }
    vstore16(height_of(met) * unit, 0, out + at);
}
