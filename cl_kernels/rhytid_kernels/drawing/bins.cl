// Draws precomputed maps of the fast method (section 2.4): the wrinkles of one orientation bin, or the
// pores, at STRETCHES of the samples at once, as codes; TILTED: and the tilt of the bin. Blocks and sums
// as in redraw.cl; each map has sums of its own. Without BULGING no profile changes sign, and there are
// no bulges. PARTS: 1, valleys and bulges in one map, or 2, a map of each, for the mellow-max.
// Error of a code at most half a step beyond that of draw.clh.
#define DRAWINGS (STRETCHES + 2 * TILTED)
#define APART SUMS_OF_BOTH
#include "codes.clh"
#include "line.clh"
#include "stretches.clh"
#include "tilt.clh"
#include "vectors.clh"

inline sums_t sums_of_drawings(place_t place, __local float *memory)
{
    sums_t sums = {memory, memory + APART - SUMS, get_local_id(0), place.low};
    for (int k = 0; k < DRAWINGS; k++)
        clear_sums(drawing_of(sums, k));
    return sums;
}

// Where the maps of a layer are among those of all: the first that is written, how many there are, how far
// bulges are behind valleys, the tilt.
typedef struct {
    int first, all, behind, tilt;
} maps_t;

// Eight texels from x on of row y of the block; i: the first of them in what is drawn.
inline void write_eight(sums_t sums, int x, int y, int i, shape_t shape, float depth,
                        __global const float8 *stretches, float share, maps_t maps,
                        __global CODE *codes)
{
    for (int k = 0; k < STRETCHES; k++)
        for (int part = 0; part < PARTS; part++) {
            float8 heights =
                heights_at(drawing_of(sums, k), x, y, shape, PARTS == 2 ? VALLEYS + part : WHOLE);
            int2 map = {maps.first + part * maps.behind + k, maps.all};
            vstore8(CODES8(heights, depth * stretches[k].z), 0, codes + code_place(i, map));
        }
    if (TILTED) {
        float8 up = depth * heights_at(drawing_of(sums, STRETCHES), x, y, shape, WHOLE);
        float8 down = depth * heights_at(drawing_of(sums, STRETCHES + 1), x, y, shape, WHOLE);
        vstore8(CODES8(tilts_of(up, down, share), CODE_LIMIT), 0,
                codes + code_place(i, (int2)(maps.tilt, maps.all)));
    }
}

// Whether nothing is drawn in eight texels from x on of row y: in half of the vectors of a bin, whose codes are
// then 0 without a logarithm for each map.
inline bool is_clear(sums_t sums, int x, int y)
{
    const int at = at_texel(sums, x, y);
    int8 bits = 0;
    for (int k = 0; k < DRAWINGS; k++) {
        bits |= as_int8(vload8(0, drawing_of(sums, k).valleys + at));
        if (BULGING)
            bits |= as_int8(vload8(0, drawing_of(sums, k).bulges + at));
    }
    return none_set(bits);
}

// The codes of such texels. To write heights of 0 by the function above takes a tenth of all maps longer.
inline void clear_eight(int i, maps_t maps, __global CODE *codes)
{
    for (int k = 0; k < STRETCHES; k++)
        for (int part = 0; part < PARTS; part++) {
            int2 map = {maps.first + part * maps.behind + k, maps.all};
            vstore8(CONVERT(CODE, 8)((int8)(0)), 0, codes + code_place(i, map));
        }
    if (TILTED)
        vstore8(CONVERT(CODE, 8)((int8)(0)), 0, codes + code_place(i, (int2)(maps.tilt, maps.all)));
}

inline void write_maps(sums_t sums, place_t place, shape_t shape, float depth,
                       __global const float8 *stretches, float share, int4 maps,
                       __global CODE *codes)
{
    const maps_t where = {maps.x, maps.y, maps.z, maps.w};
    for (int y = first_owned(sums, sums.low); y < sums.low + ROWS; y += ITEMS)
        for (int x = 0; x < BLOCK; x += LANES) {
            const int i = place.at + y * place.above + x;
            if (is_clear(sums, x, y))
                clear_eight(i, where, codes);
            else
                write_eight(sums, x, y, i, shape, depth, stretches, share, where, codes);
        }
}

#define LEAN_OF(i) (TILTED ? leaning(segments[i].zw, tilt.xyz) : 0.0f)
#if BENT && defined(WIDE)
#define DRAW_BIN(sums, shape, members, first, end, corner, least)                                  \
    DRAW_SIXTEENS(sums, shape, members, first, end, bins[i] == bin, sizes[i],                      \
                  KEEP_SHARE; lines.lean[count] = LEAN_OF(i), from_corner(lanes, corner),          \
                  stretched_lanes(lanes, stretches[k]), least,                                     \
                  LINE_AT(i, STRETCHED_SIZE(i, stretches[k], LEAN_OF(i)), corner, least))
#else
#define DRAW_BIN(sums, shape, members, first, end, corner, least)                                  \
    for (int k = 0; k < DRAWINGS; k++)                                                             \
        DRAW_EACH_LINE(drawing_of(sums, k), shape, members, first, end, bins[i] == bin,            \
                       LINE_AT(i, STRETCHED_SIZE(i, stretches[k], LEAN_OF(i)), corner, least))
#endif

// stretches: (sigma_w, sigma_d) of the samples, Alg. 1 lines 7 and 8 with their log stretch, the same at
// both ends, see stretches.clh; behind those of the samples the two of the tilt. tilt: (theta, share over
// half a bin, share). maps: see maps_t. least: as in redraw.cl.
__kernel void draw_wrinkle_bin(LINES, SHARES_OF_LINES __global const float8 *stretches,
                               __global const uchar *bins, int bin, float4 tilt,
                               __global const int *offsets, __global const int *members,
                               float4 shape_values, float least, float depth, int blocks, int row,
                               int column, int4 maps, __global CODE *codes)
{
    __local float memory[DRAWINGS * APART];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_of_drawings(place, memory);
    int block = place.block;
    DRAW_BIN(sums, shape, members, offsets[block], offsets[block + 1], place.corner, least);
    write_maps(sums, place, shape, depth, stretches, tilt.w, maps, codes);
}

// stretches: as above, without tilts.
__kernel void draw_pore_layer(__global const float2 *centres, __global const float4 *roots,
                              __global const float8 *stretches, __global const int *offsets,
                              __global const int *members, float4 shape_values, float least,
                              float depth, int blocks, int row, int column, int4 maps,
                              __global CODE *codes)
{
    __local float memory[DRAWINGS * APART];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t sums = sums_of_drawings(place, memory);
    int block = place.block;
    for (int k = 0; k < STRETCHES; k++)
        DRAW_PORES(drawing_of(sums, k), shape, members, offsets[block], offsets[block + 1], roots,
                   centres, stretches[k].xy, place.corner, least);
    write_maps(sums, place, shape, depth, stretches, 0.0f, maps, codes);
}
