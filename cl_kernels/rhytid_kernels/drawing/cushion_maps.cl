// Precomputed maps of the broad layer (cushion.cl): all lines at several log stretches, as codes. With OWNING
// the owners of samples, too (scores.clh).
// Error of a code at most half a step beyond that of cushion.cl.
#define DRAWINGS STRETCHES
#define APART SUMS
#include "codes.clh"
#include "coarse.clh"
#include "stretches.clh"
#include "vectors.clh"

#if BENT && defined(WIDE)
#define DRAW_STRETCHES(part, sums, shape, members, first, end)                                     \
    DRAW_SIXTEENS(sums, shape, members, first, end, true, sizes[i], KEEP_SHARE,                    \
                  coarse_places(part, lanes), coarse_sizes(stretched_lanes(lanes, stretches[k])),  \
                  LEAST_HALF_WIDTH, COARSE_LINE(part, i, STRETCHED_SIZE(i, stretches[k], 0.0f)))
#else
#define DRAW_STRETCHES(part, sums, shape, members, first, end)                                     \
    for (int k = 0; k < DRAWINGS; k++)                                                             \
        DRAW_EACH_LINE(drawing_of(sums, k), shape, members, first, end, true,                      \
                       COARSE_LINE(part, i, STRETCHED_SIZE(i, stretches[k], 0.0f)))
#endif

// Up to eight samples from x on of row y of the block, as codes of every stretch: as many as there are
// before the next whole eight of the target, and before `end`. i: where the first goes. Answers how many.
inline int write_samples(sums_t sums, int x, int y, int end, int i, shape_t shape, float depth,
                         __global const float8 *stretches, int2 map, __global CODE *codes)
{
    const int count = min(LANES - i % LANES, end - x);
    for (int k = 0; k < DRAWINGS; k++, map.x++) {
        float8 heights = depth * heights_at(drawing_of(sums, k), x, y, shape, VALLEYS);
        int8 found = nearest_codes8(heights * stretches[k].z, CODE_LIMIT);
        __global CODE *to = codes + code_place(i, map);
        if (count == LANES)
            vstore8(CONVERT(CODE, 8)(found), 0, to);
        else
            for (int lane = 0; lane < count; lane++)
                to[lane] = ((const int *)&found)[lane];
    }
    return count;
}

#ifdef OWNING
#define OWNERS int none, __global int *owners, int2 place_map,
#define MEMORY ((DRAWINGS + 3) * SUMS)

// Owners of those samples, and where along them each is.
inline void write_owners(sums_t sums, int x, int y, int count, int i, int2 map, __global int *owners,
                         __global CODE *codes)
{
    const owners_t found = owners_of(sums);
    const int at = at_texel(sums, x, y);
    const int8 lines = vload8(0, found.lines + at);
    const int8 places = nearest_codes8(vload8(0, found.places + at) * CODE_LIMIT, CODE_LIMIT);
    codes += code_place(i, map);
    for (int lane = 0; lane < count; lane++) {
        owners[i + lane] = ((const int *)&lines)[lane];
        codes[lane] = ((const int *)&places)[lane];
    }
}
#else
#define OWNERS
#define MEMORY (DRAWINGS * SUMS)
#endif

// As in cushion.cl. stretches: of the DRAWINGS maps, see stretches.clh, the same at both ends of a line; with
// OWNING behind them nothing stretched, with weights of one stretch.
// none: what a sample without an owner has. place_map: of places along owners, from 0 to the limit, as
// code_place has it. Error below 1e-4 of a line before they are rounded.
// map: the first of them, as code_place has it. target: where in a tile the first sample of the square
// goes, and samples a row of the tile.
__kernel void cushion_maps(LINES, SHARES_OF_LINES __global const float8 *stretches,
                           __global const int *offsets, __global const int *members,
                           float4 shape_values, float depth, int4 place, float coarse,
                           int2 target, OWNERS int2 map, __global CODE *codes)
{
    __local float memory[MEMORY];
    shape_t shape = shape_of(shape_values);
    square_t square = square_at(place, coarse);
    part_t part = part_of_group(square);
    sums_t sums;
    for (int k = DRAWINGS - 1; k >= 0; k--)
        sums = valleys_at(part, memory + k * APART);
#ifdef OWNING
    clear_owners(sums, none);
#endif
    DRAW_STRETCHES(part, sums, shape, members, offsets[part.block], offsets[part.block + 1]);
    for (int y = first_owned(sums, sums.low); y < sums.low + ROWS; y += ITEMS) {
        span_t columns = columns_of_row(part, square, y);
        int first = target.x + (part.row + BLOCK - 1 - y) * target.y + part.column;
        for (int x = columns.low; x < columns.high;) {
            const int count = write_samples(sums, x, y, columns.high, first + x, shape, depth,
                                            stretches, map, codes);
#ifdef OWNING
            write_owners(sums, x, y, count, first + x, place_map, owners, codes);
#endif
            x += count;
        }
    }
}
