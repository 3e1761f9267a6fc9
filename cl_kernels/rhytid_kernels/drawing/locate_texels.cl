// Finds the triangles of the texels of a tile: of sixteen in a row at once, for they have nearly all
// candidates in common.
#define REAL float16
#define MASK int16
#define ANY(mask) any(mask)
#include "locate.clh"

#define LANES 16

// Work-item (i, y): texels 16 i to 16 i + 15 of row y of a rectangle of `count` texels per row, of a
// level of `side` texels; row 0 is the top. offsets: of the members of each cell, and their end.
__kernel void locate_texels(__global const float *corners, __global const int *offsets,
                            __global const int *members, int cells, float reach2, int none,
                            int side, int row, int column, int count, __global int *found)
{
    const float16 centres = {0.5f, 1.5f, 2.5f,  3.5f,  4.5f,  5.5f,  6.5f,  7.5f,
                             8.5f, 9.5f, 10.5f, 11.5f, 12.5f, 13.5f, 14.5f, 15.5f};
    int first = get_global_id(0) * LANES, row_y = get_global_id(1);
    float y = (side - (row + row_y) - 0.5f) / (float)side;
    float16 x = ((float)(column + first) + centres) / (float)side;
    int from = cell_at(x.s0, y, cells), to = cell_at(x.sF, y, cells); // in one row of cells
    int16 in = locate(x, (float16)(y), corners, members, offsets[from], offsets[to + 1], reach2, none);
    found += row_y * count + first;
    if (first + LANES <= count)
        vstore16(in, 0, found);
    else
        for (int lane = 0; lane < count - first; lane++)
            found[lane] = ((int *)&in)[lane];
}
