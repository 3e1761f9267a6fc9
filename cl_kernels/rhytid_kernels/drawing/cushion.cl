// The wrinkles a second time, broad and soft, for the cushions between furrows: a coarse map, which
// spline.clh brings up. Within 1e-4 of `depth` of the same in double.
#include "coarse.clh"

// out: displacement, mesh units.
inline void write_part(sums_t sums, part_t part, square_t square, shape_t shape, float depth,
                       __global float *out)
{
    for (int y = first_owned(sums, sums.low); y < sums.low + ROWS; y += ITEMS) {
        span_t columns = columns_of_row(part, square, y);
        int row = part.row + BLOCK - 1 - y;
        __global float *to = out + row * square.side + part.column;
        for (int x = columns.low; x < columns.high; x += LANES) {
            float8 heights = depth * heights_at(sums, x, y, shape, VALLEYS);
            if (x + LANES <= columns.high)
                vstore8(heights, 0, to + x);
            else
                for (int lane = 0; lane < columns.high - x; lane++)
                    to[x + lane] = ((float *)&heights)[lane];
        }
    }
}

// Draws the lines i of the block of this group with sizes `drawn`.
#define DRAW_PART(drawn)                                                                           \
    __local float memory[SUMS];                                                                    \
    shape_t shape = shape_of(shape_values);                                                        \
    square_t square = square_at(place, coarse);                                                    \
    part_t part = part_of_group(square);                                                           \
    sums_t sums = valleys_at(part, memory);                                                        \
    DRAW_COARSE_LINES(part, sums, shape, members, offsets[part.block], offsets[part.block + 1],    \
                      drawn);                                                                      \
    write_part(sums, part, square, shape, depth, out)

// LINES: as in redraw.cl, in texels, but half widths in coarse texels. scales: of the frame, as there.
// offsets, members: those of each block that swell. place, coarse: see square_t.
__kernel void cushion(LINES, __global const SIZES *scales, __global const int *offsets,
                      __global const int *members, float4 shape_values, float depth, int4 place,
                      float coarse, __global float *out)
{
    DRAW_PART(sizes[i] * scales[i]);
}
