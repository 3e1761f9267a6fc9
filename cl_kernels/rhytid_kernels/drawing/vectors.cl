// Which triangles the texels of each vector lie in, so that a frame need not compare texel by texel.
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
