// Which triangles the texels of each cell lie in: WIDTH texels of a row and those below them. slopes.cl takes
// a cell at once. It is found once per asset.
#include "cells.clh"

// The texels of a cell whose code is `wanted` in the bits of `bits`.
inline uint coded(const uchar *codes, int bits)
{
    uint texels = 0;
    for (int k = 0; k < CELL; k++)
        texels |= (uint)((codes[k] & bits) == bits) << k;
    return texels;
}

inline uint alike(const int *triangles, int first)
{
    uint texels = 0;
    for (int k = 0; k < CELL; k++)
        texels |= (uint)(triangles[k] == triangles[first]) << k;
    return texels;
}

// The values of cell (0, 1 of the work-item) of rows of `vectors` vectors.
#define READ_CELL(from, to)                                                                    \
    int corner = 2 * get_global_id(1) * get_global_size(0) + get_global_id(0);                 \
    vstore16(vload16(corner, from), 0, to);                                                    \
    vstore16(vload16(corner + get_global_size(0), from), 1, to)

// counts: twice the number of triangles that are under the centres of a cell, and 1 where a difference
// may not use all neighbours. Work-items: vectors of a row, pairs of rows.
__kernel void count_cells(__global const int *triangles, __global const uchar *codes,
                          __global int *counts)
{
    int own[CELL], count = 0;
    uchar code[CELL];
    {
        READ_CELL(triangles, own);
    }
    {
        READ_CELL(codes, code);
    }
    uint left = coded(code, INSIDE), border = left & ~coded(code, ALL);
    for (; left; count += 2)
        left &= ~alike(own, 31 - clz(left));
    counts[get_global_id(1) * get_global_size(0) + get_global_id(0)] = count + (border != 0);
}

// members: the triangles of each cell from half of its `firsts` on, and their texels as bits.
__kernel void list_cells(__global const int *triangles, __global const uchar *codes,
                         __global const int *firsts, __global int2 *members)
{
    int own[CELL], at = firsts[get_global_id(1) * get_global_size(0) + get_global_id(0)] >> 1;
    uchar code[CELL];
    {
        READ_CELL(triangles, own);
    }
    {
        READ_CELL(codes, code);
    }
    for (uint left = coded(code, INSIDE); left; at++) {
        int k = 31 - clz(left);
        uint texels = alike(own, k) & left;
        members[at] = (int2)(own[k], as_int(texels));
        left &= ~texels;
    }
}
