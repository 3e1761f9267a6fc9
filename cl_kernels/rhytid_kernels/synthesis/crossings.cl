// Which wrinkles cross which, seen along the normal between them. A crossing is found by the longer
// of the two: an end of the shorter lies within half of its length, so within half of the longer's,
// and as much again on a surface whose curve takes the two apart.
#include "points.clh"

inline float side_of(float3 along, float3 to, float3 normal)
{
    return dot(cross(along, to), normal);
}

// Whether segment ab crosses cd. Both are in the order of their numbers, and ab is the lower of the
// two, so that the answer is the same whichever finds the other: the sum of the normals of a and b
// says from where it is seen. Most segments do not reach over the line of the other, which is found
// out first.
inline bool cross_over(int a, int b, int c, int d, __global const int *place,
                       __global const float *normal, float scale)
{
    int3 p = vload3(a, place);
    float3 to_b = between(p, vload3(b, place), scale);
    float3 to_c = between(p, vload3(c, place), scale), to_d = between(p, vload3(d, place), scale);
    float3 facing = vload3(a, normal) + vload3(b, normal);
    if (!(side_of(to_b, to_c, facing) * side_of(to_b, to_d, facing) < 0.0f))
        return false;
    float3 along = to_d - to_c;
    return side_of(along, -to_c, facing) * side_of(along, to_b - to_c, facing) < 0.0f &&
           same_sheet(facing, vload3(c, normal) + vload3(d, normal));
}

inline bool outside(int3 p, int3 low, int3 high)
{
    return any(p < low) || any(p > high);
}

// Of edges `near` to e those that cross it are put among its partners, the numbers of which ascend.
inline int add_partners(const int *near, int waiting, int e, __global const int *nodes,
                        __global const int *place, __global const float *normal, float scale,
                        int k, int total, __global int *found)
{
    for (int w = 0; w < waiting; w++) {
        int f = near[w], low = min(e, f), high = max(e, f);
        if (!cross_over(nodes[2 * low], nodes[2 * low + 1], nodes[2 * high], nodes[2 * high + 1],
                        place, normal, scale))
            continue;
        int at = min(total, CROSSINGS);
        while (at > 0 && found[k * CROSSINGS + at - 1] > f)
            at--;
        if (at > 0 && found[k * CROSSINGS + at - 1] == f)
            continue;
        for (int s = min(total, CROSSINGS - 1); s > at; s--)
            found[k * CROSSINGS + s] = found[k * CROSSINGS + s - 1];
        if (at < CROSSINGS)
            found[k * CROSSINGS + at] = f;
        total++;
    }
    return total;
}

// Edges that wait to be looked at together: which of them are short enough no processor can guess.
#define NEAR 64

// The hint keeps compilers from taking several edges at once in one vector: they go through lists of
// different lengths, and Intel's for processors takes seven times as long that way.
// found: for each of `count` edges from number `start` on its partners that are no longer, at most
// CROSSINGS, ascending; much: how many there are.
__attribute__((vec_type_hint(float4)))
__kernel void find_crossings(int first, int count, int start, __global const int *nodes,
                             __global const float *length, __global const int *offsets,
                             __global const int *edges, __global const int *others,
                             __global const int *place, __global const float *normal, float unit,
                             float scale, int cell, uint mask, __global const int *head,
                             __global const int *next, __global int *found, __global int *much)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int e = start + k, total = 0, waiting = 0, near[NEAR];
    int a = nodes[2 * e], b = nodes[2 * e + 1];
    float own = length[e];
    int3 p = vload3(a, place), q = vload3(b, place);
    int around = convert_int_rtp(own / unit);
    int3 low = sub_sat(min(p, q), (int3)(around)), high = add_sat(max(p, q), (int3)(around));
    low = max(low, 0); // beyond these nothing lies
    high = min(high, 1 << 30);
    FOR_POINTS(c, low / cell, high / cell)
    {
        if (c == a || c == b || outside(vload3(c, place), low, high))
            continue;
        for (int h = offsets[c]; h < offsets[c + 1]; h++) {
            int f = edges[h], d = others[h];
            bool longer = (length[f] > own) | ((length[f] == own) & (f > e));
            near[waiting] = f;
            // Where both ends are near, the lower one finds the edge.
            bool found_from_d = (d < c) & !outside(vload3(d, place), low, high);
            waiting += !(longer | (d == a) | (d == b) | found_from_d);
            if (waiting == NEAR) {
                total = add_partners(near, waiting, e, nodes, place, normal, scale, k, total, found);
                waiting = 0;
            }
        }
    }
    much[k] = add_partners(near, waiting, e, nodes, place, normal, scale, k, total, found);
}
