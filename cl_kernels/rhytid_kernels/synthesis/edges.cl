// Candidate wrinkles: pairs of points that are ways of each other, each once, in spatial order.
#include "points.clh"

inline bool leads_to(__global const int *ways, int from, int to)
{
    for (int s = 0; s < WAYS; s++)
        if (ways[from * WAYS + s] == to)
            return true;
    return false;
}

__kernel void count_edges(int first, int count, __global const int *ways, __global int *edges)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int found = 0;
    for (int s = 0; s < WAYS; s++) {
        int j = ways[i * WAYS + s];
        found += j > i && leads_to(ways, j, i);
    }
    edges[i] = found;
}

// Those of a point from offsets[i] on, by the number of the other.  unit: of places, on the surface.
__kernel void list_edges(int first, int count, __global const int *ways,
                         __global const int *offsets, __global const int *place, float unit,
                         __global int *nodes, __global float *length)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int end = offsets[i];
    for (int s = 0; s < WAYS; s++) {
        int j = ways[i * WAYS + s];
        if (j <= i || !leads_to(ways, j, i))
            continue;
        int at = end++;
        for (; at > offsets[i] && nodes[2 * at - 1] > j; at--)
            nodes[2 * at + 1] = nodes[2 * at - 1];
        nodes[2 * at] = i;
        nodes[2 * at + 1] = j;
    }
    for (int e = offsets[i]; e < end; e++) {
        nodes[2 * e] = i;
        float3 d = between(vload3(i, place), vload3(nodes[2 * e + 1], place), unit);
        length[e] = sqrt(dot(d, d));
    }
}
