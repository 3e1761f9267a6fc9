// Blends precomputed maps by the stretch of each texel's triangle (Alg. 3, lines 11 to 14).
// A vector of texels per work-item. What Alg. 3 computes up to line 10 is the same in a whole triangle,
// so its numbers are read once for a vector, and each texel takes those of its own.

#include "ahead.clh"
#include "merge.clh"
#include "tiles.clh"
#include "vectors.clh"
#ifdef RAISED
#include "spline.clh"
#endif
#ifdef GRAINY
#include "grain.clh"
#endif

// Numbers of one triangle, of two or of three, and the texels in the second and in the third. count: how many,
// known to the compiler. Not in arrays, which PoCL keeps in memory.
typedef struct {
    int count;
    __global const float *first, *second, *third;
    int16 in_second, in_third;
} triangles_t;

#define IN_PLACE inline __attribute__((always_inline))

// numbers: so many of every triangle.
IN_PLACE triangles_t triangles_of(__global const int2 *members, int count, __global const float *numbers,
                                  int each)
{
    const int2 second = members[count > 1 ? 1 : 0], third = members[count > 2 ? 2 : 0];
    triangles_t triangles = {count, numbers + members[0].x * each, numbers + second.x * each,
                             numbers + third.x * each, lanes_of(second.y), lanes_of(third.y)};
    return triangles;
}

// Number k of the triangle that each texel lies in.
IN_PLACE float16 chosen(triangles_t triangles, int k)
{
    float16 number = triangles.first[k];
    if (triangles.count > 1)
        number = select(number, (float16)(triangles.second[k]), triangles.in_second);
    return triangles.count > 2 ? select(number, (float16)(triangles.third[k]), triangles.in_third) : number;
}

// Of each texel the code that lies so many after the first of the two samples around the place of its
// triangle. coefficients: four of each, of weights.cl, read one by one, so that each is loaded into all lanes
// at once; the third is the place.
#define CODES_AFTER(coefficients, at)                                                              \
    convert_int16(vload16(0, maps + CODES_BEFORE((coefficients)[2]) + (at)))

// Codes are chosen as whole numbers, in the instruction that loads them, so that a vector is blended once,
// and without a branch, wherever its triangles lie.
IN_PLACE float16 own_codes(__global const CODE *maps, triangles_t own, int at)
{
    int16 codes = CODES_AFTER(own.first, at);
    if (own.count > 1)
        codes = select(codes, CODES_AFTER(own.second, at), own.in_second);
    if (own.count > 2)
        codes = select(codes, CODES_AFTER(own.third, at), own.in_third);
    return convert_float16(codes);
}

// Each texel linear between two samples, by the coefficients of its triangle.
IN_PLACE float16 between_own(__global const CODE *maps, triangles_t own)
{
    return own_codes(maps, own, 0) * chosen(own, 0) + own_codes(maps, own, WIDTH) * chosen(own, 1);
}

// Algorithm 3, lines 11 to 14, in units of the merge. own: the coefficients of the triangles, from what lines
// 5 to 10 compute (weights.cl). With TILT, the depth scale of a bin is a line over the angle at which the
// wrinkle of a texel runs.
IN_PLACE float16 merged_heights(__global const CODE *maps, triangles_t own)
{
    merge_state_t merged = NOTHING_MERGED;
    for (int n = 0; n < LAYERS; n++) {
        for (int part = 0; part < PARTS; part++) {
            float16 d = between_own(maps + LAYER_AT(n, part), own);
#if TILT
            if (n < LAYERS - 1)
                d += d * (FLOATS_OF(maps + TILT_AT(n)) * chosen(own, 3));
#endif
            merged = accumulate(merged, d);
        }
        own.first += 4;
        own.second += 4;
        own.third += 4;
    }
    return height_of(merged);
}

// Heights in units of the merge, and gains of the grain.
typedef struct {
    float16 heights, gains;
} blended_t;

IN_PLACE blended_t blended(__global const CODE *maps, __global const int2 *members, int count,
                           __global const float *coefficients, __global const float *gains)
{
    blended_t found = {merged_heights(maps, triangles_of(members, count, coefficients, 4 * LAYERS)), 0.0f};
#ifdef GRAINY
    found.gains = chosen(triangles_of(members, count, gains, 1), 0);
#endif
    return found;
}

// The same of all triangles of a vector.
IN_PLACE blended_t blended_all(__global const CODE *maps, __global const int2 *members, int count,
                               __global const float *coefficients, __global const float *gains)
{
    if (count == 1)
        return blended(maps, members, 1, coefficients, gains);
    if (count == 2)
        return blended(maps, members, 2, coefficients, gains);
    blended_t all = blended(maps, members, 3, coefficients, gains);
    for (int t = 3; t < count; t++) {
        const blended_t one = blended(maps, members + t, 1, coefficients, gains);
        all.heights = select(all.heights, one.heights, lanes_of(members[t].y));
        all.gains = select(all.gains, one.gains, lanes_of(members[t].y));
    }
    return all;
}

// firsts, members: the triangles of each vector. codes: of each vector those of all maps, side by side
// in memory: what a work-item reads is one stream, in order. coefficients: LAYERS x 4 per triangle, of
// weights.cl. unit: of the merge, mesh units. out: displacement, mesh units; within 1e-6 of the
// largest step times code of the same in double. Where RAISED is defined, coarse: the broad layer
// around the tile, which has `width` texels per row. Where GRAINY is, grain: its codes; gains: of each
// triangle; amplitude of a code and depth in mesh units.
inline void blend_vector(__global const int *firsts, __global const int2 *members,
                         __global const CODE *codes, __global const float *coarse,
                         __global const char *grain, __global const float *coefficients,
                         __global const float *gains, float unit, int width, float amplitude,
                         float depth, __global float *out)
{
    int i = get_global_id(0), first = firsts[i];
    if (members[first].y & CLEAR) {
        vstore16((float16)(0.0f), 0, out + i * WIDTH);
        return;
    }
    codes += (size_t)i * VECTOR_CODES;
    ASK_AHEAD(codes, VECTOR_CODES);
    const blended_t all =
        blended_all(codes, members + first, firsts[i + 1] - first, coefficients, gains);
    float16 d = all.heights * unit;
#ifdef RAISED
    d += brought_up16(coarse, width, i * WIDTH);
#endif
#ifdef GRAINY
    d = grained(d, convert_float16(vload16(0, grain + i * WIDTH)), all.gains, amplitude, depth);
#endif
    vstore16(d, 0, out + i * WIDTH);
}

#define TILE(k)                                                                                    \
    __global const int *firsts##k, __global const int2 *members##k, __global const CODE *codes##k, \
        __global const char *grain##k, __global float *out##k,
#define CHOOSE(k)                                                                                  \
    OF_TILE(k, tile, firsts), OF_TILE(k, tile, members), OF_TILE(k, tile, codes),                  \
        OF_TILE(k, tile, grain), OF_TILE(k, tile, out);

// As blend_vector has it. coarse: of all tiles, `values` each. It is in vectors already: without the hint
// Intel's compiler packs work-items, which takes half as long again.
__kernel __attribute__((vec_type_hint(float16))) void
blend(OF_TILES(TILE) __global const float *coefficients, __global const float *gains,
      __global const float *coarse, int values, float unit, int width, float amplitude, float depth)
{
    const int tile = get_global_id(1);
    __global const int *firsts = 0;
    __global const int2 *members = 0;
    __global const CODE *codes = 0;
    __global const char *grain = 0;
    __global float *out = 0;
    OF_TILES(CHOOSE)
    blend_vector(firsts, members, codes, coarse + tile * values, grain, coefficients, gains, unit, width,
                 amplitude, depth, out);
}
