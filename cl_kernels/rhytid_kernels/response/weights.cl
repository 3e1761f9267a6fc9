// Where between the precomputed samples each triangle stands (Alg. 3, lines 6 to 10). With nearest
// sampling Alg. 3 up to its line 10 is the same for every texel of a triangle, so it runs here once.
#include "grain.clh"
#include "groups.clh"
#include "samples.clh"
#include "vectors.clh"

POWER_OF_TWO(power16, float16, int16)

// Else PoCL calls them, copies what they take, and keeps vectors in memory around each call.
#define IN_PLACE inline __attribute__((always_inline))

// r of layer n in triangle t: one layer for each orientation bin, the last for the pores. Those from
// ORIENTED on take the mean of both axes: the pores, and a single bin. directions: theta of each bin.
// jacobians: NULL for angles in UV.
inline float layer_stretch(int n, int t, __global const float4 *axes, __global const float2 *logs,
                           __global const float4 *jacobians, __global const float2 *directions)
{
    return n < ORIENTED ? log_stretch_in(t, directions[n], axes, logs, jacobians)
                        : mean_log_stretch(logs[t]);
}

// What LANES triangles have in their lanes: axes (s1, s2), and the logs of both principal stretches.
typedef struct {
    float16 x1, y1, x2, y2, log1, log2;
} triangles_t;

// Triangles from `first` on, the last again where there are no more. axes: as in angles_in.
IN_PLACE triangles_t triangles_from(int first, int last, __global const float4 *axes,
                                    __global const float2 *logs, __global const float4 *jacobians)
{
    float found[6][LANES];
    for (int lane = 0; lane < LANES; lane++) {
        int t = min(first + lane, last);
        float4 s = angles_in(t, (float2)(1.0f, 0.0f), axes, jacobians).axes;
        found[0][lane] = s.x;
        found[1][lane] = s.y;
        found[2][lane] = s.z;
        found[3][lane] = s.w;
        found[4][lane] = logs[t].x;
        found[5][lane] = logs[t].y;
    }
    triangles_t p = {vload16(0, found[0]), vload16(0, found[1]), vload16(0, found[2]),
                     vload16(0, found[3]), vload16(0, found[4]), vload16(0, found[5])};
    return p;
}

// log_stretch_in of each, the same bits: products that `dot` adds are no fused ones.
inline float16 log_stretches_in(triangles_t p, int first, int last, float2 theta,
                                __global const float4 *jacobians)
{
    float16 x = theta.x, y = theta.y;
    if (jacobians) {
        float turned[2][LANES];
        for (int lane = 0; lane < LANES; lane++) {
            float2 own = on_surface(jacobians[min(first + lane, last)], theta);
            turned[0][lane] = own.x;
            turned[1][lane] = own.y;
        }
        x = vload16(0, turned[0]);
        y = vload16(0, turned[1]);
    }
    const float16 along1 = x * p.x1, across1 = y * p.y1, along2 = x * p.x2, across2 = y * p.y2;
    return ACROSS(along1 + across1, along2 + across2, p.log1, p.log2);
}

// Where triangles stand in a layer.
typedef struct {
    float16 place; // from 0 (full compression) to SAMPLES_OF - 1 (full stretch)
    float16 depth; // what the depth is scaled by
    float16 rise;  // with TILT, as a line over the tilts
} standing_t;

// Algorithm 3, lines 6 to 10, for layer n. The depth scale is 1, or for maps without theirs sigma_d of
// the stretch before it is clamped to r_max, that of the last sample; with TILT it rises as a line over
// the tilts to the largest code of one, given over the middle. That is the line through two angles of the
// bin. It stays within 0 and SCALE_LIMIT.
// directions: then also those TILT_NODE half bins before and after each. exponents: of the depth of
// wrinkles and of pores, where 0 gives 1, and the limits of both depths.
IN_PLACE standing_t standing(int n, triangles_t p, int first, int last,
                             __global const float4 *jacobians, __global const float2 *directions,
                             float r_max, float4 exponents)
{
    float16 r = n < ORIENTED ? log_stretches_in(p, first, last, directions[n], jacobians)
                             : 0.5f * (p.log1 + p.log2);
    const float2 depth_of = n < LAYERS - 1 ? exponents.xz : exponents.yw;
    const float log_of_limit = LOG2_OF(depth_of.y);
    const float16 place = (clamp(r / r_max, -1.0f, 1.0f) + 1.0f) * (0.5f * (SAMPLES_OF(n) - 1));
    float16 depth, rise = 0.0f;
#if TILT
    if (n < ORIENTED) {
        __global const float2 *turned = directions + ORIENTED + n;
        float16 before = log_stretches_in(p, first, last, turned[0], jacobians);
        float16 after = log_stretches_in(p, first, last, turned[ORIENTED], jacobians);
        float16 low = SCALE(power16, before, -depth_of.x, SCALE_LIMIT);
        float16 high = SCALE(power16, after, -depth_of.x, SCALE_LIMIT);
        depth = 0.5f * (low + high);
        rise = (high - low) / (2.0f * TILT_NODE * depth);
        float16 most = min(SCALE_LIMIT / depth - 1.0f, 1.0f);
        rise = clamp(rise, -most, most) / CODE_LIMIT;
    } else
#endif
        depth = SCALE_BELOW(power16, r, -depth_of.x, depth_of.y, log_of_limit);
    const standing_t found = {place, depth, rise};
    return found;
}

// What blend.cl multiplies by: of the first and of the second of the two samples around the place of a
// triangle, in units of the merge for a code; where the first of them is, which CODES_BEFORE takes; the rise.
typedef struct {
    float16 first, second, place, rise;
} coefficients_t;

// Of triangles, from where they stand in layer n. steps: displacement of a code, LAYERS x MOST_SAMPLES. unit:
// of the merge, mesh units.
IN_PLACE coefficients_t coefficients_at(int n, standing_t at, __global const float *steps, float unit)
{
    const int16 sample = min(convert_int16(at.place), SAMPLES_OF(n) - 2);
    const float16 share = at.place - convert_float16(sample), scale = at.depth / unit;
    float16 of_first = 0.0f, of_second = 0.0f;
    steps += n * MOST_SAMPLES;
    for (int m = 0; m < SAMPLES_OF(n) - 1; m++) {
        of_first = select(of_first, (float16)(steps[m]), sample == m);
        of_second = select(of_second, (float16)(steps[m + 1]), sample == m);
    }
    const coefficients_t found = {scale * (1.0f - share) * of_first, scale * share * of_second,
                                  PLACE_OF(convert_float16(sample * WIDTH)), at.rise};
    return found;
}

// Stores those of some lanes, each behind LAYERS of the one before.
IN_PLACE void store_coefficients(coefficients_t c, int lanes, __global float4 *to)
{
    float first[LANES], second[LANES], place[LANES], rise[LANES];
    vstore16(c.first, 0, first);
    vstore16(c.second, 0, second);
    vstore16(c.place, 0, place);
    vstore16(c.rise, 0, rise);
    for (int i = 0; i < lanes; i++)
        to[i * LAYERS] = (float4)(first[i], second[i], place[i], rise[i]);
}

// The coefficients of every layer of LANES triangles a work-item, LAYERS per triangle, and the gains of
// their grain (GRAIN_GAIN), unless these are NULL. groups: as in first_in_group, of triangles; count: of
// all.
__kernel void coefficients(__global const int *groups, __global const float4 *axes,
                           __global const float2 *logs, __global const float4 *jacobians,
                           __global const float2 *directions, int count, float r_max,
                           float4 exponents, __global const float *steps, float unit,
                           float grain_exponent, __global float *gains, __global float4 *found)
{
    const int first = first_in_group(groups), last = count - 1, lanes = min(LANES, count - first);
    const triangles_t p = triangles_from(first, last, axes, logs, jacobians);
    for (int n = 0; n < LAYERS; n++) {
        const standing_t at = standing(n, p, first, last, jacobians, directions, r_max, exponents);
        store_coefficients(coefficients_at(n, at, steps, unit), lanes, found + first * LAYERS + n);
    }
    if (gains) {
        float gain[LANES];
        vstore16(GRAIN_GAIN(power16, p.log1, p.log2, grain_exponent), 0, gain);
        for (int i = 0; i < lanes; i++)
            gains[first + i] = gain[i];
    }
}

// For texels with a stiffness of their own (blend_stiff.cl): r of each layer, LAYERS per triangle;
// with TILT then two more of as many, with directions as in standing.
__kernel void layer_stretches(__global const float4 *axes, __global const float2 *logs,
                              __global const float4 *jacobians,
                              __global const float2 *directions, __global float *stretches)
{
    const int sides = TILT ? 3 : 1;
    int t = get_global_id(0);
    for (int side = 0; side < sides; side++)
        for (int n = 0; n < LAYERS; n++)
            stretches[(t * sides + side) * LAYERS + n] =
                layer_stretch(n, t, axes, logs, jacobians, directions + side * ORIENTED);
}
