// Poisson-disk sampling by darts, many at a time. Two points are too close where their distance is
// below the radius times the mean of their spacing factors.
#include "points.clh"

#define WAITING 0
#define KEPT 1
#define DROPPED 2

inline bool too_close(int3 p, int3 q, float one, float other, float scale)
{
    float3 d = between(p, q, scale);
    float limit = 0.5f * (one + other);
    return dot(d, d) < limit * limit;
}

// room: 1 for a dart that no pore is too close to. scale: 1/radius. level: of a dart; where skin has
// fewer pores, those of a higher level than one over the squared factor are none.
__kernel void find_room(int first, int count, __global const int *triangle,
                        __global const int *place, __global const float *normal,
                        __global const float *factor, __global const float *level,
                        __global const int *pore_place, __global const float *pore_normal,
                        __global const float *pore_factor, int cell, uint mask, __global const int *head, __global const int *next,
                        float scale, __global uchar *room)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int3 p = vload3(i, place), at = p / cell;
    float3 n = vload3(i, normal);
    bool hit = triangle[i] < 0 || level[i] * factor[i] * factor[i] >= 1.0f;
    for (int z = at.z - 1; z <= at.z + 1 && !hit; z++)
        for (int y = at.y - 1; y <= at.y + 1 && !hit; y++)
            for (int x = at.x - 1; x <= at.x + 1 && !hit; x++)
                for (int j = head[bucket(x, y, z, mask)]; j >= 0 && !hit; j = next[j])
                    hit = too_close(p, vload3(j, pore_place), factor[i], pore_factor[j], scale) &&
                          same_sheet(n, vload3(j, pore_normal));
    room[i] = !hit;
}

// One round over the darts listed[first..count): a dart goes where an earlier one that is too close
// was kept, stays where no earlier one still waits, and waits else. Rounds until `waiting` stays 0
// give what throwing them one by one in the order of (priority, number) gives.
__kernel void decide_darts(int first, int count, __global const int *listed,
                           __global const int *place, __global const float *normal,
                           __global const float *factor, __global const uint *priority, int cell,
                           uint mask, __global const int *head, __global const int *next,
                           float scale, __global const uchar *before, __global uchar *after,
                           __global int *waiting)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = listed[k];
    uchar state = before[i];
    if (state == WAITING) {
        int3 p = vload3(i, place), at = p / cell;
        float3 n = vload3(i, normal);
        state = KEPT;
        FOR_POINTS(j, at - 1, at + 1)
        {
            bool earlier = priority[j] < priority[i] || (priority[j] == priority[i] && j < i);
            if (earlier && state != DROPPED && before[j] != DROPPED &&
                too_close(p, vload3(j, place), factor[i], factor[j], scale) &&
                same_sheet(n, vload3(j, normal)))
                state = before[j] == KEPT ? DROPPED : WAITING;
        }
        if (state == WAITING)
            atomic_or(waiting, 1);
    }
    after[i] = state;
}

// Darts listed[first..count) become pores from number `from` on.
__kernel void take_darts(int first, int count, int from, __global const int *listed,
                         __global const int *triangle, __global const int *place,
                         __global const float *normal, __global const float2 *uv,
                         __global const float *factor, __global int *pore_triangle,
                         __global int *pore_place, __global float *pore_normal,
                         __global float2 *pore_uv, __global float *pore_factor)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = listed[k], pore = from + k;
    pore_triangle[pore] = triangle[i];
    vstore3(vload3(i, place), pore, pore_place);
    vstore3(vload3(i, normal), pore, pore_normal);
    pore_uv[pore] = uv[i];
    pore_factor[pore] = factor[i];
}
