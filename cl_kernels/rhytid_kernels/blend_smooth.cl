// As blend.cl with smooth sampling: every texel has a stretch of its own (Alg. 3, lines 2 to 14).
// A vector of texels a work-item.
#include "merge.clh"
#include "response.clh"
#include "vectors.clh"

#define REAL float16
#define MASK int16
#define ANY(mask) any(mask)
#include "smooth.clh"

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

inline float16 difference(float2 theta, float16 u, float16 v) // 1 - |theta . s|
{
    return fmax(1.0f - fabs(theta.x * u + theta.y * v), 0.0f);
}

// Alg. 1, lines 4 and 5, for wrinkles along theta.
inline float16 across(float2 theta, principal_t p)
{
    float16 d1 = difference(theta, p.u1, p.v1), d2 = difference(theta, p.u2, p.v2);
    return (d1 * p.log1 + d2 * p.log2) / (d1 + d2 + EPSILON);
}

inline float16 depth_scale(float16 r, float exponent) // as scales_of; exponent 0 gives 1
{
    if (exponent == 0.0f)
        return 1.0f;
    return clamp(exp(-exponent * r), 1.0f / SCALE_LIMIT, SCALE_LIMIT);
}

inline float least(float16 x)
{
    float8 a = fmin(x.lo, x.hi);
    float4 b = fmin(a.lo, a.hi);
    float2 c = fmin(b.lo, b.hi);
    return fmin(c.x, c.y);
}

// Linear between the two samples around each position. Only those that a texel needs are read.
inline float16 between(__global const CODE *maps, float16 position, __global const float *steps)
{
    int first = (int)least(position), last = (int)ceil(-least(-position));
    float16 sum = 0.0f;
    for (int m = first; m <= last; m++)
        sum += FLOATS_OF(maps + m * WIDTH) * (fmax(1.0f - fabs(position - m), 0.0f) * steps[m]);
    return sum;
}

// firsts, members, codes, steps, merge: as in blend.cl, of a tile of `width` texels a side, from texel
// (row, column) of a level of `side` texels on. directions, r_max, exponents: as in weights.cl.
__kernel void blend_smooth(__global const int *firsts, __global const int2 *members,
                           __global const CODE *codes, __global const float *steps,
                           __global const float2 *directions, float r_max, float2 exponents,
                           float2 merge, int width, int side, int row, int column,
                           __global const float *corners, __global const int *vertices,
                           __global const float8 *fields, int none, float limit, __global float *out)
{
    int i = get_global_id(0), at = i * WIDTH;
    float16 x = (columns(at, width) + (column + 0.5f)) / side;
    float16 y = (side - row - 0.5f - rows(at, width)) / side;
    field_t field = fields_at(members + firsts[i], members + firsts[i + 1], x, y, corners, vertices,
                              fields, none);
    principal_t p = principal(field, limit);
    codes += (size_t)i * (LAYERS * PARTS * SAMPLES * WIDTH);
    float16 heights = 0.0f, valleys = 1.0f, bulges = 1.0f;
    for (int n = 0; n < LAYERS; n++) {
        float16 r = n < ORIENTED ? across(directions[n], p) : 0.5f * (p.log1 + p.log2);
        float16 share = clamp(r * (1.0f / r_max), -1.0f, 1.0f);
        float16 position = (share + 1.0f) * (0.5f * (SAMPLES - 1));
        float16 depth = depth_scale(r, n < LAYERS - 1 ? exponents.x : exponents.y);
        __global const CODE *maps = codes + n * PARTS * SAMPLES * WIDTH;
        float16 d = depth * between(maps, position, steps + n * SAMPLES);
#if PARTS == 1
        heights = n == 0 ? d : min(heights, d);
#else
        valleys += grown(-d, merge);
        bulges += grown(depth * between(maps + SAMPLES * WIDTH, position, steps + n * SAMPLES), merge);
#endif
    }
#if PARTS != 1
    heights = log(bulges / valleys) * (merge.x / merge.y);
#endif
    vstore16(heights, 0, out + at);
}
