// Lists of points by cell. The order in a list is whichever came first: no result may depend on it.
#include "points.clh"

// Points listed[first..count), put into the lists under their number.
__kernel void insert_points(int first, int count, __global const int *listed,
                            __global const int *place, int cell, uint mask, __global int *head,
                            __global int *next)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = listed[k];
    int3 at = vload3(i, place) / cell;
    next[i] = atomic_xchg(head + bucket(at.x, at.y, at.z, mask), i);
}

// Points from..count of one array.
__kernel void insert_range(int first, int count, int from, __global const int *place, int cell,
                           uint mask, __global int *head, __global int *next)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = from + k;
    int3 at = vload3(i, place) / cell;
    next[i] = atomic_xchg(head + bucket(at.x, at.y, at.z, mask), i);
}
