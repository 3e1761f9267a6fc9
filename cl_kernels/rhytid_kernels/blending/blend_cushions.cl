// Blends the precomputed maps of the broad layer: each sample by the stretch of its owner, the line that
// counts most there (owners.cl). A vector of samples per work-item.
#include "ahead.clh"
#include "codes.clh"
#include "response.clh"
#include "tiles.clh"
#include "vectors.clh"

#define VECTOR_CODES ((SAMPLES + 1) * WIDTH)

POWER_OF_TWO(power16, float16, int16)

// Asks for r of the owners that a vector some vectors on has. 12 and fewer took longer, 24 and more as long.
#define OWNERS_AHEAD 16

inline void ask_for_owners(__global const int *owners, int i, __global const float2 *stretches)
{
    owners += min(i + OWNERS_AHEAD, (int)get_global_size(0) - 1) * WIDTH;
    UNROLLED for (int lane = 0; lane < WIDTH; lane++)
        SOON_ALONE(stretches + owners[lane]);
}

// r of eight lines at both ends: put together in registers, for a processor waits where it reads as a
// vector what it has just stored one by one. In halves, so that none waits for all before it.
#define ENDS_OF_TWO(lines) ((float4)(stretches[(lines)[0]], stretches[(lines)[1]]))
#define ENDS_OF_FOUR(lines) ((float8)(ENDS_OF_TWO(lines), ENDS_OF_TWO((lines) + 2)))
#define ENDS_OF(lines) ((float16)(ENDS_OF_FOUR(lines), ENDS_OF_FOUR((lines) + 4)))

// r of the owners of a vector of samples, each at its place along it. stretches: r at both ends of each
// line. places: codes.
inline float16 owner_stretch(__global const int *owners, __global const CODE *places,
                             __global const float2 *stretches)
{
    float16 low = ENDS_OF(owners), high = ENDS_OF(owners + WIDTH / 2);
    float16 first = (float16)(low.even, high.even), along = FLOATS_OF(places) * (1.0f / CODE_LIMIT);
    return first + along * ((float16)(low.odd, high.odd) - first);
}

// Between these samples nine of ten vectors lie as a whole in a strong expression, and in long runs: the others
// count nothing there.
#define INNER_FIRST (SAMPLES / 2 - 2)
#define INNER_LAST (SAMPLES / 2 + 1)

// Of heights at samples `first` to `last` those at positions, linear between two of them.
inline __attribute__((always_inline)) float16 sum_of(__global const CODE *codes, __global const float *steps,
                                                     float16 position, int first, int last)
{
    float16 sum = 0.0f, at = first; // counted in lanes: a whole number is made a float slowly
    for (int m = first; m <= last; m++, at += 1.0f)
        sum += FLOATS_OF(codes + m * WIDTH) * (max(1.0f - fabs(position - at), (float16)(0.0f)) * steps[m]);
    return sum;
}

// owners: row by row, as clear_samples leaves them. codes: of each vector those of SAMPLES maps, then
// places. steps: displacement of a code of each sample. last: log stretch of the last sample. exponent: of
// the depth scale. out: displacement, mesh units, row by row; within 1e-6 of the largest step times code of
// the same in double.
inline void blend_samples(__global const int *owners, __global const CODE *codes,
                          __global const float2 *stretches, __global const float *steps, float last,
                          float exponent, __global float *out)
{
    int i = get_global_id(0);
    if (owners[i * WIDTH] < 0) { // clear
        vstore16((float16)(0.0f), i, out);
        return;
    }
    codes += (size_t)i * VECTOR_CODES;
    ASK_AHEAD(codes, VECTOR_CODES);
    ASK_AHEAD(owners + i * WIDTH, WIDTH);
    ask_for_owners(owners, i, stretches);
    float16 r = owner_stretch(owners + i * WIDTH, codes + SAMPLES * WIDTH, stretches);
    float16 position = (clamp(r * (1.0f / last), -1.0f, 1.0f) + 1.0f) * (0.5f * (SAMPLES - 1));
    float16 sum;
    if (any((position < INNER_FIRST) | (position > INNER_LAST)))
        sum = sum_of(codes, steps, position, 0, SAMPLES - 1);
    else
        sum = sum_of(codes, steps, position, INNER_FIRST, INNER_LAST);
    vstore16(SCALE(power16, r, -exponent, SCALE_LIMIT) * sum, i, out);
}

#define TILE(k) __global const int *owners##k, __global const CODE *codes##k,
#define CHOOSE(k) OF_TILE(k, tile, owners), OF_TILE(k, tile, codes);

// out: of all tiles, one after the other, `values` each. With the hint as in blend.cl.
__kernel __attribute__((vec_type_hint(float16))) void
blend_cushions(OF_TILES(TILE) __global const float2 *stretches, __global const float *steps, float last,
               float exponent, int values, __global float *out)
{
    const int tile = get_global_id(1);
    __global const int *owners = 0;
    __global const CODE *codes = 0;
    OF_TILES(CHOOSE)
    blend_samples(owners, codes, stretches, steps, last, exponent, out + tile * values);
}
