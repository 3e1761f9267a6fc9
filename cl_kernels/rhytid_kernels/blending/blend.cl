// Blends precomputed maps by the stretch of each texel's triangle (Alg. 3, lines 11 to 14).
// A vector of texels per work-item. What Alg. 3 computes up to line 10 is the same in a whole triangle,
// so a vector is blended once for each triangle in it, and each texel takes its own.

#include "ahead.clh"
#include "merge.clh"
#include "vectors.clh"
#ifdef RAISED
#include "spline.clh"
#endif
#ifdef GRAINY
#include "grain.clh"
#endif

// The codes of two neighbouring samples. place: the third coefficient. Only these are read.
typedef struct {
    float16 first, second;
} neighbours_t;

inline neighbours_t neighbours(__global const CODE *maps, float place)
{
    maps += CODES_BEFORE(place);
    neighbours_t n = {FLOATS_OF(maps), FLOATS_OF(maps + WIDTH)};
    return n;
}

// Linear between them. coefficients: four, of weights.cl, read one by one, so that each is loaded into all
// lanes at once.
inline float16 between(neighbours_t codes, __global const float *coefficients)
{
    return codes.first * coefficients[0] + codes.second * coefficients[1];
}

// Algorithm 3, lines 11 to 14, as if every texel lay in one triangle, in units of the merge.
// coefficients: of that triangle, from what lines 5 to 10 compute (weights.cl). With TILT, the depth
// scale of a bin is a line over the angle at which the wrinkle of a texel runs.
inline float16 blend_triangle(__global const CODE *maps, __global const float4 *coefficients)
{
    merge_state_t merged = NOTHING_MERGED;
    for (int n = 0; n < LAYERS; n++) {
        __global const float *own = (__global const float *)(coefficients + n);
        for (int part = 0; part < PARTS; part++) {
            float16 d = between(neighbours(maps + LAYER_AT(n, part), own[2]), own);
#if TILT
            if (n < LAYERS - 1)
                d += d * (FLOATS_OF(maps + TILT_AT(n)) * own[3]);
#endif
            merged = accumulate(merged, d);
        }
    }
    return height_of(merged);
}

// The same of two triangles at once, which mostly lie between the same samples: codes are made floats once.
typedef struct {
    float16 first, second;
} two_heights_t;

inline __attribute__((always_inline)) two_heights_t blend_two(__global const CODE *maps,
                                                              __global const float4 *of_first,
                                                              __global const float4 *of_second)
{
    merge_state_t first = NOTHING_MERGED, second = NOTHING_MERGED;
    for (int n = 0; n < LAYERS; n++) {
        __global const float *own = (__global const float *)(of_first + n);
        __global const float *other = (__global const float *)(of_second + n);
        for (int part = 0; part < PARTS; part++) {
            neighbours_t codes = neighbours(maps + LAYER_AT(n, part), own[2]);
            float16 d = between(codes, own);
            if (as_int(own[2]) != as_int(other[2]))
                codes = neighbours(maps + LAYER_AT(n, part), other[2]);
            float16 e = between(codes, other);
#if TILT
            if (n < LAYERS - 1) {
                const float16 tilt = FLOATS_OF(maps + TILT_AT(n));
                d += d * (tilt * own[3]);
                e += e * (tilt * other[3]);
            }
#endif
            first = accumulate(first, d);
            second = accumulate(second, e);
        }
    }
    two_heights_t two = {height_of(first), height_of(second)};
    return two;
}

// firsts, members: the triangles of each vector. codes: of each vector those of all maps, side by side
// in memory: what a work-item reads is one stream, in order. coefficients: LAYERS per triangle, of
// weights.cl. unit: of the merge, mesh units. out: displacement, mesh units; within 1e-6 of the
// largest step times code of the same in double. Where RAISED is defined, coarse: the broad layer
// around the tile, which has `width` texels per row. Where GRAINY is, grain: its codes; gains: of each
// triangle; amplitude of a code and depth in mesh units.
inline void blend_vector(__global const int *firsts, __global const int2 *members,
                         __global const CODE *codes, __global const float *coarse,
                         __global const char *grain, __global const float4 *coefficients,
                         __global const float *gains, float unit, int width, float amplitude,
                         float depth, __global float *out)
{
    int i = get_global_id(0), member = firsts[i], end = firsts[i + 1];
    if (members[member].y & CLEAR) {
        vstore16((float16)(0.0f), 0, out + i * WIDTH);
        return;
    }
    codes += (size_t)i * VECTOR_CODES;
    ASK_AHEAD(codes, VECTOR_CODES);
    float16 d = 0.0f;
#ifdef GRAINY
    float16 gain = 0.0f;
#endif
    if ((end - member) & 1) { // one alone, then two at a time
        const int triangle = members[member++].x;
        d = blend_triangle(codes, coefficients + triangle * LAYERS);
#ifdef GRAINY
        gain = gains[triangle];
#endif
    }
    for (; member < end; member += 2) {
        const int2 first = members[member], second = members[member + 1];
        const two_heights_t two =
            blend_two(codes, coefficients + first.x * LAYERS, coefficients + second.x * LAYERS);
        d = select(select(d, two.first, lanes_of(first.y)), two.second, lanes_of(second.y));
#ifdef GRAINY
        gain = select(gain, (float16)(gains[first.x]), lanes_of(first.y));
        gain = select(gain, (float16)(gains[second.x]), lanes_of(second.y));
#endif
    }
    d *= unit;
#ifdef RAISED
    d += brought_up16(coarse, width, i * WIDTH);
#endif
#ifdef GRAINY
    d = grained(d, convert_float16(vload16(0, grain + i * WIDTH)), gain, amplitude, depth);
#endif
    vstore16(d, 0, out + i * WIDTH);
}

// Up to four tiles of as many texels at once, as blend_vector has it: work-item (vector, tile).
#define TILE(k)                                                                                    \
    __global const int *firsts##k, __global const int2 *members##k, __global const CODE *codes##k, \
        __global const float *coarse##k, __global const char *grain##k, __global float *out##k
#define BLEND(k)                                                                                   \
    case k:                                                                                        \
        blend_vector(firsts##k, members##k, codes##k, coarse##k, grain##k, coefficients, gains,    \
                     unit, width, amplitude, depth, out##k);                                       \
        break;

// It is in vectors already: without the hint Intel's compiler packs work-items, which takes half as
// long again.
__kernel __attribute__((vec_type_hint(float16))) void
blend(TILE(0), TILE(1), TILE(2), TILE(3), __global const float4 *coefficients,
      __global const float *gains, float unit, int width, float amplitude, float depth)
{
    switch (get_global_id(1)) {
        BLEND(0)
        BLEND(1)
        BLEND(2)
        BLEND(3)
    }
}
