// Which triangles the texels of each cell lie in: WIDE texels of HIGH rows. slopes.cl takes a cell at once. It
// is found once per asset.
#include "cells.clh"

// The texels of a cell whose code is `wanted` in the bits of `bits`.
inline ulong coded(const uchar *codes, int bits)
{
    ulong texels = 0;
    for (int k = 0; k < CELL; k++)
        texels |= (ulong)((codes[k] & bits) == bits) << k;
    return texels;
}

inline ulong alike(const int *triangles, int first)
{
    ulong texels = 0;
    for (int k = 0; k < CELL; k++)
        texels |= (ulong)(triangles[k] == triangles[first]) << k;
    return texels;
}

// The values of cell (0, 1 of the work-item) of rows of global size 0 cells.
#define READ_CELL(from, to)                                                                    \
    int cells = get_global_size(0), first = HIGH * get_global_id(1) * cells + get_global_id(0); \
    for (int k = 0; k < HIGH; k++)                                                             \
    vstore16(vload16(first + k * cells, from), k, to)

// counts: twice the number of triangles that are under the centres of a cell, and 1 where a difference
// may not use all neighbours. Work-items: cells of a row, rows of cells.
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
    ulong left = coded(code, INSIDE), border = left & ~coded(code, ALL);
    for (; left; count += 2)
        left &= ~alike(own, 63 - clz(left));
    counts[get_global_id(1) * get_global_size(0) + get_global_id(0)] = count + (border != 0);
}

// members: the triangles of each cell from half of its `firsts` on, and their texels as bits, of the upper
// rows first.
__kernel void list_cells(__global const int *triangles, __global const uchar *codes,
                         __global const int *firsts, __global int *members)
{
    int own[CELL], at = firsts[get_global_id(1) * get_global_size(0) + get_global_id(0)] >> 1;
    uchar code[CELL];
    {
        READ_CELL(triangles, own);
    }
    {
        READ_CELL(codes, code);
    }
    for (ulong left = coded(code, INSIDE); left; at++) {
        int k = 63 - clz(left);
        ulong texels = alike(own, k) & left;
        vstore3((int3)(own[k], as_int2(texels)), at, members);
        left &= ~texels;
    }
}
