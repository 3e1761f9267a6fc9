// Poisson-disk sampling by darts, many at a time.
#include "rooms.clh"

#define WAITING 0
#define KEPT 1
#define DROPPED 2

// Pores are read as one line of the cache each: place, factor, normal, and the next of the list.
inline int8 record_of(int3 place, float factor, float3 normal)
{
    return (int8)(place, as_int(factor), as_int3(normal), -1);
}

inline void keep_pore(int pore, int8 record, int cell, uint mask, __global int *head,
                      __global int8 *pores)
{
    int3 at = record.s012 / cell;
    record.s7 = atomic_xchg(head + bucket(at.x, at.y, at.z, mask), pore);
    pores[pore] = record;
}

// room: 1 for a dart that counts and that no pore is too close to. scale: 1/radius. level: of a dart.
__kernel void find_room(int first, int count, __global const int *triangle,
                        __global const int *place, __global const float *normal,
                        __global const float *factor, __global const float *level, int cell,
                        uint mask, __global const int *head, __global const int *pores,
                        float scale, __global uchar *room)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    room[i] = triangle[i] >= 0 && counts(level[i], factor[i]) &&
              has_room(vload3(i, place), vload3(i, normal), factor[i], cell, mask, head, pores,
                       scale);
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
        int3 p = vload3(i, place);
        float3 n = vload3(i, normal);
        around_t around = cells_around(p, cell);
        state = KEPT;
        FOR_NEAR(j, around, state != DROPPED, next[j])
        {
            bool earlier = priority[j] < priority[i] || (priority[j] == priority[i] && j < i);
            if (earlier && before[j] != DROPPED &&
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
                         __global const float *factor, int cell, uint mask, __global int *head,
                         __global int8 *pores, __global int *pore_triangle,
                         __global float2 *pore_uv)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = listed[k], pore = from + k;
    pore_triangle[pore] = triangle[i];
    pore_uv[pore] = uv[i];
    keep_pore(pore, record_of(vload3(i, place), factor[i], vload3(i, normal)), cell, mask, head,
              pores);
}

// Pores first..count, moved to other lists and arrays.
__kernel void move_pores(int first, int count, __global const int8 *old,
                         __global const int *old_triangle, __global const float2 *old_uv, int cell,
                         uint mask, __global int *head, __global int8 *pores,
                         __global int *pore_triangle, __global float2 *pore_uv)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    pore_triangle[i] = old_triangle[i];
    pore_uv[i] = old_uv[i];
    keep_pore(i, old[i], cell, mask, head, pores);
}
