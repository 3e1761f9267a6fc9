// Poisson-disk sampling by darts, many at a time.
#include "rooms.clh"

#define WAITING 0
#define KEPT 1
#define DROPPED 2

// A pore as it was kept: place, factor, normal, and the number of its list.
inline int8 record_of(int3 place, float factor, float3 normal, int cell, uint mask)
{
    int3 at = place / cell;
    return (int8)(place, as_int(factor), as_int3(normal), (int)bucket(at.x, at.y, at.z, mask));
}

// room: 1 for a dart that counts and that no pore is too close to. scale: 1/radius. level: of a dart.
__kernel void find_room(int first, int count, __global const int *triangle,
                        __global const int *place, __global const float *normal,
                        __global const float *factor, __global const float *level, int cell,
                        uint mask, __global const int *starts, __global const int *numbers,
                        int most, float scale, __global uchar *room)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    pores_t pores = {mask, starts, numbers, most, scale};
    room[i] = triangle[i] >= 0 && counts(level[i], factor[i]) &&
              has_room(vload3(i, place), vload3(i, normal), factor[i], cell, &pores);
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
                         __global const float *factor, int cell, uint mask, __global int8 *pores,
                         __global int *pore_triangle, __global float2 *pore_uv)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = listed[k], pore = from + k;
    pore_triangle[pore] = triangle[i];
    pore_uv[pore] = uv[i];
    pores[pore] = record_of(vload3(i, place), factor[i], vload3(i, normal), cell, mask);
}

// Pores first..count, moved to other arrays.
__kernel void move_pores(int first, int count, __global const int8 *old,
                         __global const int *old_triangle, __global const float2 *old_uv, int cell,
                         uint mask, __global int8 *pores, __global int *pore_triangle,
                         __global float2 *pore_uv)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    pore_triangle[i] = old_triangle[i];
    pore_uv[i] = old_uv[i];
    int8 pore = old[i];
    pores[i] = record_of(pore.s012, as_float(pore.s3), as_float3(pore.s456), cell, mask);
}

// starts: before all else 0; then of each list how many pores it has, two places after its own, so that
// sums of all up to a place are where the list before it begins, and once that list is filled, ends.
__kernel void count_pores(int first, int count, __global const int *pores, __global int *starts)
{
    int i = first + get_global_id(0);
    if (i < count)
        atomic_inc(starts + pores[8 * i + 7] + 2);
}

// As in dart_selection.py.
#define CHUNK 1024

// The sum of each CHUNK of starts. The hint keeps compilers from taking several chunks at once in one
// vector, which lie far apart.
__attribute__((vec_type_hint(int8)))
__kernel void sum_chunks(int first, int count, __global const int *starts, __global int *sums)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int sum = 0;
    for (int l = 0; l < CHUNK; l++)
        sum += starts[k * CHUNK + l];
    sums[k] = sum;
}

// In place of each number of a chunk the sum of all up to it.  before: the sum of the chunks before
// each.
__attribute__((vec_type_hint(int8)))
__kernel void add_up_chunks(int first, int count, __global const int *before, __global int *starts)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int sum = before[k];
    for (int l = 0; l < CHUNK; l++)
        starts[k * CHUNK + l] = sum += starts[k * CHUNK + l];
}

// order: the pores by their lists.
__kernel void order_pores(int first, int count, __global const int *pores, __global int *starts,
                          __global int *order)
{
    int i = first + get_global_id(0);
    if (i < count)
        order[atomic_inc(starts + pores[8 * i + 7] + 1)] = i;
}

// numbers: those of pores in this order, and of eight that are none, as pores_t has them.
__kernel void list_pores(int first, int room, __global const int8 *pores, __global const int *order,
                         __global int *numbers)
{
    int k = first + get_global_id(0);
    if (k >= room)
        return;
    int8 pore = k < room - 8 ? pores[order[k]] : (int8)(-1); // a factor of these bits is no number
    numbers[k] = pore.s0;
    numbers[k + room] = pore.s1;
    numbers[k + 2 * room] = pore.s2;
    numbers[k + 3 * room] = pore.s3;
    numbers[k + 4 * room] = pore.s4;
    numbers[k + 5 * room] = pore.s5;
    numbers[k + 6 * room] = pore.s6;
}
