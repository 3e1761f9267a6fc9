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

// Linear between two neighbouring samples. Only these are read. coefficients: four, of weights.cl, read
// one by one, so that each is loaded into all lanes at once.
inline float16 between(__global const CODE *maps, __global const float *coefficients)
{
    maps += CODES_BEFORE(coefficients[2]);
    return FLOATS_OF(maps) * coefficients[0] + FLOATS_OF(maps + WIDTH) * coefficients[1];
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
            float16 d = between(maps + LAYER_AT(n, part), own);
#if TILT
            if (n < LAYERS - 1)
                d += d * (FLOATS_OF(maps + TILT_AT(n)) * own[3]);
#endif
            merged = accumulate(merged, d);
        }
    }
    return height_of(merged);
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
    float16 d = blend_triangle(codes, coefficients + members[member].x * LAYERS);
#ifdef GRAINY
    float16 gain = gains[members[member].x];
#endif
    for (member++; member < end; member++) {
        float16 other = blend_triangle(codes, coefficients + members[member].x * LAYERS);
        d = select(d, other, lanes_of(members[member].y));
#ifdef GRAINY
        gain = select(gain, (float16)(gains[members[member].x]), lanes_of(members[member].y));
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
