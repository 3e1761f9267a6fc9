// The lines of a coarse net laid along the edges of a fine one, from pore to pore.
#include "points.clh"

// The point nearest to each of some places, within factor/scale and on its sheet; -1 for none.
__kernel void nearest_point(int first, int count, __global const int *place,
                            __global const float *normal, __global const int *point_place,
                            __global const float *point_normal, int cell, uint mask,
                            __global const int *head, __global const int *next, float scale,
                            __global const float *factor, __global int *nearest)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int3 p = vload3(i, place), at = p / cell;
    float3 n = vload3(i, normal);
    float best = factor[i] * factor[i];
    int found = -1;
    FOR_POINTS(j, at - 1, at + 1)
    {
        float3 d = between(p, vload3(j, point_place), scale);
        float distance2 = dot(d, d);
        bool nearer = distance2 < best || (distance2 == best && (j < found || found < 0));
        if (nearer && same_sheet(n, vload3(j, point_normal))) {
            best = distance2;
            found = j;
        }
    }
    nearest[i] = found;
}

// The way out that leads to `goal` with the least detour, and nearer to it; -1 for none.
inline int way_to(int node, int3 goal, __global const int *offsets, __global const int *others,
                  __global const int *place, float scale)
{
    int3 p = vload3(node, place);
    float3 ahead = between(p, goal, scale);
    float left = sqrt(dot(ahead, ahead)), best = INFINITY;
    int found = -1;
    for (int h = offsets[node]; h < offsets[node + 1]; h++) {
        int3 q = vload3(others[h], place);
        float3 step = between(p, q, scale), rest = between(q, goal, scale);
        float after = sqrt(dot(rest, rest)), way = sqrt(dot(step, step)) + after;
        if (after < left && way < best) {
            best = way;
            found = h;
        }
    }
    return found;
}

// Every line goes step by step from its first pore to its second; where it arrives, the edges on
// its way get its weight, a whole number, if they have none that is larger.
__kernel void lay_routes(int first, int count, int steps, __global const int *ends,
                         __global const int *weight, __global const int *offsets,
                         __global const int *edges, __global const int *others,
                         __global const int *place, float scale, __global int *laid)
{
    int i = first + get_global_id(0);
    if (i >= count || ends[2 * i] < 0 || ends[2 * i + 1] < 0)
        return;
    int3 goal = vload3(ends[2 * i + 1], place);
    bool arrives = false;
    for (int pass = 0; pass == 0 || (pass == 1 && arrives); pass++) {
        int node = ends[2 * i];
        for (int k = 0; k < steps && node != ends[2 * i + 1]; k++) {
            int way = way_to(node, goal, offsets, others, place, scale);
            if (way < 0)
                break;
            if (pass == 1)
                atomic_max(laid + edges[way], weight[i]);
            node = others[way];
        }
        arrives = node == ends[2 * i + 1];
    }
}
