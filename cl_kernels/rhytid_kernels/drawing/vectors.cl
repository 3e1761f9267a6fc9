// Which triangles the texels of each vector lie in, so that a frame need not compare texel by texel; and which
// vectors have nothing in them, so that it passes over these: much of a map lies beyond its charts.
#include "vectors.clh"

// The texels of a vector that lie in the triangle of texel `first`, as bits.
inline int alike(const int *triangles, int first)
{
    int texels = 0;
    for (int lane = 0; lane < WIDTH; lane++)
        texels |= (triangles[lane] == triangles[first]) << lane;
    return texels;
}

// Whether all texels of a vector lie in one triangle, as those of most do.
inline bool in_one(int16 triangles)
{
    const int16 apart = triangles ^ triangles.s0;
    return none_set(apart.lo | apart.hi);
}

// counts: how many triangles each vector has.
__kernel void count_triangles(__global const int *triangles, __global int *counts)
{
    int i = get_global_id(0), count = 0, own[WIDTH];
    const int16 all = vload16(i, triangles);
    if (in_one(all)) {
        counts[i] = 1;
        return;
    }
    vstore16(all, 0, own);
    for (int left = (1 << WIDTH) - 1; left; count++)
        left &= ~alike(own, 31 - clz(left));
    counts[i] = count;
}

// members: the triangles of vector i from firsts[i] on.
__kernel void list_triangles(__global const int *triangles, __global const int *firsts,
                             __global int2 *members)
{
    int i = get_global_id(0), at = firsts[i], own[WIDTH];
    const int16 all = vload16(i, triangles);
    if (in_one(all)) {
        members[at] = (int2)(all.s0, (1 << WIDTH) - 1);
        return;
    }
    vstore16(all, 0, own);
    for (int left = (1 << WIDTH) - 1; left; at++) {
        int lane = 31 - clz(left), texels = alike(own, lane);
        members[at] = (int2)(own[lane], texels);
        left &= ~texels;
    }
}

// Whether so many quads of codes are 0.
inline bool all_zero(__global const int4 *codes, int quads)
{
    int4 bits = 0;
    for (int k = 0; k < quads; k++)
        bits |= codes[k];
    return !(bits.x | bits.y | bits.z | bits.w);
}

// Of the broad layer: a vector of samples without a height has the complement of its first owner, which is
// negative. quads: of the codes of a vector, all and those of heights.
__kernel void clear_samples(__global const int4 *codes, int2 quads, __global int *owners)
{
    const int i = get_global_id(0);
    if (all_zero(codes + (size_t)i * quads.x, quads.y))
        owners[i * WIDTH] = ~owners[i * WIDTH];
}

// Whether all samples that spline.clh brings up to vector i are clear: four rows of them, each in two vectors
// at most. width: of the tile.
inline bool is_under_clear(__global const int *owners, int i, int width, int coarser)
{
    const int row = i * WIDTH / width, x = i * WIDTH % width, side = width / coarser + 4;
    int first = (row + coarser / 2) / coarser * side + x / coarser, last = first + WIDTH / coarser + 3;
    for (int k = 0; k < 4; k++, first += side, last += side)
        if (owners[first / WIDTH * WIDTH] >= 0 || owners[last / WIDTH * WIDTH] >= 0)
            return false;
    return true;
}

// quads: of the codes of a vector. none: the triangle of texels in none. owners: of the broad layer, after
// clear_samples; NULL where there is none.
__kernel void clear_vectors(__global const int4 *codes, int quads, int none,
                            __global const int *owners, int width, int coarser,
                            __global const int *firsts, __global int2 *members)
{
    const int i = get_global_id(0);
    const int2 first = members[firsts[i]];
    if (first.x == none && first.y == (1 << WIDTH) - 1 && all_zero(codes + (size_t)i * quads, quads) &&
        (!owners || is_under_clear(owners, i, width, coarser)))
        members[firsts[i]].y = first.y | CLEAR;
}
