// Owners of the samples of the broad layer, see scores.clh, where arcs.clh draws no sixteen lines at once.
#include "codes.clh"
#include "coarse.clh"
#include "shared_sizes.clh"
#include "vectors.clh"

// Scores and owners of the samples of a block, as sums_t has its sums.
#ifdef WIDE
#define WHOLES int16
#define LOADED(from) (vload8(0, from), vload8(0, (from) + STRIDE))
#define STORED(values, to)                                                                         \
    do {                                                                                           \
        vstore8((values).lo, 0, to);                                                               \
        vstore8((values).hi, 0, (to) + STRIDE);                                                    \
    } while (0)
#else
#define WHOLES int8
#define LOADED(from) (vload8(0, from))
#define STORED(values, to) vstore8(values, 0, to)
#endif

inline void compete(__local float *scores, __local int *owners, near_t near, int line)
{
    REALS score = scores_of(near), best = (REALS)LOADED(scores);
    WHOLES better = score > best;
    STORED(select(best, score, better), scores);
    STORED(select((WHOLES)LOADED(owners), (WHOLES)(line), better), owners);
}

inline void clear_owners(sums_t sums, __local int *owners, int none)
{
    for (int y = first_owned(sums, sums.low); y < sums.low + SUMS / STRIDE; y += ITEMS)
        for (int x = 0; x < STRIDE; x++) {
            sums.valleys[at_texel(sums, x, y)] = LEAST_SCORE;
            owners[at_texel(sums, x, y)] = none;
        }
}

inline void draw_owner(sums_t sums, __local int *owners, ready_t l, int line)
{
    for (int x = l.box.columns.low; x <= l.box.columns.high; x += LANES)
        for (int y = l.box.rows.low; y <= l.box.rows.high; y += ROWS_AT_ONCE) {
            int at = at_texel(sums, x, y);
            near_t near = near_line(l, column_centres(x) - l.start.x, row_centres(y) - l.start.y);
            compete(sums.valleys + at, owners + at, near, line);
        }
}

// LINES: as in cushion.cl, where nothing is stretched, with weights of one stretch. target: as in
// cushion_maps.cl. owners: of each sample, `none` where it has none. map, codes: as code_place has them,
// of the place along the owner, from 0 to the limit; 0 of a line without bends, which answers alike from
// end to end. Error below 1e-4 of a line before it is rounded.
__kernel void cushion_owners(LINES, SHARES int none, __global const int *offsets,
                             __global const int *members, float4 shape_values, float depth,
                             int4 place, float coarse, int2 target,
                             __global int *owners, int2 map, __global CODE *codes)
{
    __local float memory[SUMS];
    __local int best[SUMS];
    shape_t shape = shape_of(shape_values);
    square_t square = square_at(place, coarse);
    part_t part = part_of_group(square);
    sums_t sums = {memory, memory, get_local_id(0), part.low};
    clear_owners(sums, best, none);
    for (int k = offsets[part.block]; k < offsets[part.block + 1]; k++)
        draw_owner(sums, best,
                   ready_line(sums, COARSE_LINE(part, members[k], SIZES_OF(members[k])), shape),
                   members[k]);
    for (int y = first_owned(sums, sums.low); y < sums.low + ROWS; y += ITEMS) {
        span_t columns = columns_of_row(part, square, y);
        int first = target.x + (part.row + BLOCK - 1 - y) * target.y + part.column;
        for (int x = columns.low; x < columns.high; x++) {
            int i = best[at_texel(sums, x, y)];
            float along = 0.0f;
#if BENT
            if (i != none) {
                ready_t l = ready_line(sums, COARSE_LINE(part, i, SIZES_OF(i)), shape);
                near_t near = foot_on(l, (REALS)(x + 0.5f - l.start.x), (REALS)(y + 0.5f - l.start.y));
                along = near.there.s0;
            }
#endif
            owners[first + x] = i;
            codes[code_place(first + x, map)] =
                nearest_codes8((float8)(along * CODE_LIMIT), CODE_LIMIT).s0;
        }
    }
}
