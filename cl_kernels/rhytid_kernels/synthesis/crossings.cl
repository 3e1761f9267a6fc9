// Which wrinkles cross which, seen along the normal between them. A crossing is found by the longer
// of the two: an end of the shorter lies within half of its length, so within half of the longer's,
// and as much again on a surface whose curve takes the two apart.
#include "points.clh"

inline float side_of(float3 along, float3 to, float3 normal)
{
    return dot(cross(along, to), normal);
}

// Places relative to one of them, in 1/scale; normal: the sum of a's and b's.
inline bool cross_over(float3 a, float3 b, float3 c, float3 d, float3 normal)
{
    bool parted = side_of(b - a, c - a, normal) * side_of(b - a, d - a, normal) < 0.0f;
    bool parting = side_of(d - c, a - c, normal) * side_of(d - c, b - c, normal) < 0.0f;
    return parted && parting;
}

inline bool cross_in_order(int e, int f, __global const int *nodes, __global const int *place,
                           __global const float *normal, float scale)
{
    int low = min(e, f), high = max(e, f); // the same answer whichever finds the other
    int a = nodes[2 * low], b = nodes[2 * low + 1], c = nodes[2 * high], d = nodes[2 * high + 1];
    int3 p = vload3(a, place);
    float3 between_ab = vload3(a, normal) + vload3(b, normal);
    float3 between_cd = vload3(c, normal) + vload3(d, normal);
    return same_sheet(between_ab, between_cd) &&
           cross_over((float3)(0.0f), between(p, vload3(b, place), scale),
                      between(p, vload3(c, place), scale), between(p, vload3(d, place), scale),
                      between_ab);
}

inline bool outside(int3 p, int3 low, int3 high)
{
    return any(p < low) || any(p > high);
}

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
    int e = start + k, total = 0;
    int a = nodes[2 * e], b = nodes[2 * e + 1];
    int3 p = vload3(a, place), q = vload3(b, place);
    int around = convert_int_rtp(length[e] / unit);
    int3 low = sub_sat(min(p, q), (int3)(around)), high = add_sat(max(p, q), (int3)(around));
    low = max(low, 0); // beyond these nothing lies
    high = min(high, 1 << 30);
    FOR_POINTS(c, low / cell, high / cell)
    {
        if (c == a || c == b || outside(vload3(c, place), low, high))
            continue;
        for (int h = offsets[c]; h < offsets[c + 1]; h++) {
            int f = edges[h], d = others[h];
            bool longer = length[f] > length[e] || (length[f] == length[e] && f > e);
            if (longer || d == a || d == b ||
                !cross_in_order(e, f, nodes, place, normal, scale))
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
    }
    much[k] = total;
}
