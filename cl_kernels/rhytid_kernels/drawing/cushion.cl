// The wrinkles a second time, broad and soft, for the cushions between furrows: a map COARSER times
// as coarse as the texels, which spline.clh brings up. A work-group draws ROWS rows of a block of
// COARSE_BLOCK x COARSE_BLOCK coarse texels and of APRON more around it, BLOCK texels per side; the
// apron is written where the square ends. Within 1e-4 of `depth` of the same in double.
#include "line.clh"
#include "shared_sizes.clh"

#define COARSE (1.0f / COARSER)
#define SNAP 4096.0f // to the texel
#define LEAST_WIDE 1e-6f // so that a width of 0 has a ratio

// A square of the coarse map with APRON samples more around it: `side` a row, the first in
// (row, column), which may be -APRON. Blocks of the whole map, in a row: `blocks`.
typedef struct {
    int row, column, side, blocks;
} square_t;

// The block of this group, counted from the top left; its first row and column in the square; where
// the square goes on beyond it, the apron belongs to another group.
typedef struct {
    int block, row, column; // row: the upper one of the apron
    float2 corner;          // the lower left one of the apron, coarse texels of the UDIM, v up
    int low, top, left, bottom, right;
} part_t;

inline part_t part_of_group(square_t square)
{
    const int parts = BLOCK / ROWS, down = get_group_id(1) / parts;
    int row = (square.row + APRON) / COARSE_BLOCK + down;
    int column = (square.column + APRON) / COARSE_BLOCK + get_group_id(0);
    bool first_down = down == 0, last_down = down == get_num_groups(1) / parts - 1;
    bool first = get_group_id(0) == 0, last = get_group_id(0) == get_num_groups(0) - 1;
    part_t p = {row * square.blocks + column,
                row * COARSE_BLOCK - APRON - square.row,
                column * COARSE_BLOCK - APRON - square.column,
                (float2)(column, square.blocks - 1 - row) * (float)COARSE_BLOCK - (float)APRON,
                get_group_id(1) % parts * ROWS,
                first_down ? 0 : APRON,
                first ? 0 : APRON,
                last_down ? BLOCK : BLOCK - APRON,
                last ? BLOCK : BLOCK - APRON};
    return p;
}

// Only valleys: a line without a bulge raises nothing. memory: SUMS.
inline sums_t valleys_at(part_t part, __local float *memory)
{
    sums_t sums = {memory, memory, get_local_id(0), part.low};
    for (int y = first_owned(sums, sums.low); y < sums.low + SUMS / STRIDE; y += ITEMS)
        for (int x = 0; x < STRIDE; x += 4)
            vstore4((float4)(0.0f), 0, memory + at_texel(sums, x, y));
    return sums;
}

// The half width that a line is drawn with: the spline widens what it brings up, and takes from its
// middle. Drawn this much narrower, and as much deeper, a lone line keeps its mean, whatever the
// samples are, and from 1.8 samples on within 4 % its depth. Within LEAST_HALF_WIDTH it is its own.
inline float narrowed(float half_width)
{
    float square = max(half_width * half_width - WIDENED, 0.0f);
    return max(sqrt(square), min(half_width, LEAST_HALF_WIDTH));
}

inline SIZES narrowed_sizes(SIZES size)
{
#if BENT
    float2 wide = max(size.xy, (float2)(LEAST_WIDE));
    float2 drawn = (float2)(narrowed(wide.x), narrowed(wide.y));
    return (float4)(drawn, size.zw * (wide / drawn));
#else
    float wide = max(size.x, LEAST_WIDE), drawn = narrowed(wide);
    return (float2)(drawn, size.y * (wide / drawn));
#endif
}

// Places are rounded so that they are the same from the corner of any block: a sample has the same
// bits whichever group draws it. Lines that the samples do not carry keep their mean. line: from
// the corner of the UDIM in texels, with sizes as they are drawn, half widths in coarse texels.
inline line_t coarse_line(part_t part, line_t line)
{
    line.start = rint(line.start * SNAP) * (COARSE / SNAP) - part.corner;
    line.extent *= COARSE;
    line.wave.x *= COARSE;
    line.size = narrowed_sizes(line.size);
    return line;
}

// out: displacement, mesh units.
inline void write_part(sums_t sums, part_t part, square_t square, shape_t shape, float depth,
                       __global float *out)
{
    for (int y = first_owned(sums, sums.low); y < sums.low + ROWS; y += ITEMS) {
        int down = BLOCK - 1 - y, row = part.row + down;
        if (down < part.top || down >= part.bottom || row < 0 || row >= square.side)
            continue;
        int left = max(part.left, -part.column);
        int right = min(part.right, square.side - part.column);
        __global float *to = out + row * square.side + part.column;
        for (int x = left; x < right; x += LANES) {
            float8 heights = depth * heights_at(sums, x, y, shape, VALLEYS);
            if (x + LANES <= right)
                vstore8(heights, 0, to + x);
            else
                for (int lane = 0; lane < right - x; lane++)
                    to[x + lane] = ((float *)&heights)[lane];
        }
    }
}

// Draws the lines i of the block of this group for which `chosen` holds, with sizes `drawn`.
#define DRAW_PART(chosen, drawn)                                                                   \
    __local float memory[SUMS];                                                                    \
    shape_t shape = shape_of(shape_values);                                                        \
    square_t square = {place.x, place.y, place.z, place.w};                                        \
    part_t part = part_of_group(square);                                                           \
    sums_t sums = valleys_at(part, memory);                                                        \
    DRAW_LINES(sums, shape, members, offsets[part.block], offsets[part.block + 1], chosen,         \
               coarse_line(part, (line_t)LINE_AT(i, drawn, (float2)(0.0f), LEAST_HALF_WIDTH)));    \
    write_part(sums, part, square, shape, depth, out)

// LINES: as in redraw.cl, in texels, but half widths in coarse texels. scales: of the frame, as there.
// offsets, members: those of each block that swell.
__kernel void cushion(LINES, __global const SIZES *scales, __global const int *offsets,
                      __global const int *members, float4 shape_values, float depth, int4 place,
                      __global float *out)
{
    DRAW_PART(true, sizes[i] * scales[i]);
}

// Those of one orientation bin, all at one stretch: bins to scale as in bins.cl.
__kernel void cushion_bin(LINES, SHARES __global const uchar *bins, int bin, float2 scale,
                          __global const int *offsets, __global const int *members,
                          float4 shape_values, float depth, int4 place, __global float *out)
{
    DRAW_PART(bins[i] == bin, SIZES_OF(i) * SCALES(scale));
}
