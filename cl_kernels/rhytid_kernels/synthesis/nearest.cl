// The nearest points of each point, on its sheet: how far they are, and which way they lie. The nearest
// come first; of equal distances the lower number first.
#include "points.clh"

// Between discs that are one radius apart, 26 fit within 2.2 radii on a flat surface.
#define MOST_NEAR 40

typedef struct {
    int count;
    int number[MOST_NEAR];
    float distance2[MOST_NEAR];
} near_t;

inline bool nearer(float distance2, int number, float other2, int other)
{
    return distance2 < other2 || (distance2 == other2 && number < other);
}

// Keeps the `most` nearest, each once.
inline void put_near(near_t *near, int most, int number, float distance2)
{
    int at = near->count;
    while (at > 0 && nearer(distance2, number, near->distance2[at - 1], near->number[at - 1]))
        at--;
    if (at >= most || (at > 0 && near->number[at - 1] == number))
        return;
    near->count = min(near->count + 1, most);
    for (int k = near->count - 1; k > at; k--) {
        near->distance2[k] = near->distance2[k - 1];
        near->number[k] = near->number[k - 1];
    }
    near->distance2[at] = distance2;
    near->number[at] = number;
}

// The points within `reach` times the mean of both spacing factors; distances in 1/scale.
inline void gather_near(near_t *near, int most, int i, __global const int *place,
                        __global const float *normal, __global const float *factor, int cell,
                        uint mask, __global const int *head, __global const int *next, float scale,
                        float reach)
{
    int3 p = vload3(i, place), at = p / cell;
    float3 n = vload3(i, normal);
    near->count = 0;
    FOR_POINTS(j, at - 1, at + 1)
    {
        float3 d = between(p, vload3(j, place), scale);
        float distance2 = dot(d, d), limit = 0.5f * reach * (factor[i] + factor[j]);
        if (j != i && distance2 <= limit * limit && same_sheet(n, vload3(j, normal)))
            put_near(near, most, j, distance2);
    }
}

// In place of the first of a row of `ways`: more than WAYS points are within reach.
#define MANY -2

// For each point those within reach, nearest first, in a row of WAYS, -1 where there are no more; the
// squared distance of the first, infinity without one. And the farthest of its `neighbours` nearest:
// its squared distance and its number; infinity where fewer are within reach.
__kernel void list_near(int first, int count, int neighbours, __global const int *place,
                        __global const float *normal, __global const float *factor, int cell,
                        uint mask, __global const int *head, __global const int *next, float scale,
                        float reach, __global float *nearest2, __global float *far2,
                        __global int *far, __global int *ways)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    near_t near;
    gather_near(&near, max(neighbours, WAYS + 1), i, place, normal, factor, cell, mask, head, next,
                scale, reach);
    bool enough = near.count >= neighbours;
    nearest2[i] = near.count ? near.distance2[0] : INFINITY;
    far2[i] = enough ? near.distance2[neighbours - 1] : INFINITY;
    far[i] = enough ? near.number[neighbours - 1] : INT_MAX;
    for (int s = 0; s < WAYS; s++)
        ways[i * WAYS + s] = s < near.count ? near.number[s] : -1;
    if (near.count > WAYS)
        ways[i * WAYS] = MANY;
}

// What `list_near` found of a point, or all that are within reach where they were too many for it.
inline void recall_near(near_t *near, int i, __global const int *ways, __global const int *place,
                        __global const float *normal, __global const float *factor, int cell,
                        uint mask, __global const int *head, __global const int *next, float scale,
                        float reach)
{
    if (ways[i * WAYS] == MANY) {
        gather_near(near, MOST_NEAR, i, place, normal, factor, cell, mask, head, next, scale, reach);
        return;
    }
    int3 p = vload3(i, place);
    int found = 0;
    for (; found < WAYS && ways[i * WAYS + found] >= 0; found++) {
        int j = ways[i * WAYS + found];
        float3 d = between(p, vload3(j, place), scale);
        near->number[found] = j;
        near->distance2[found] = dot(d, d);
    }
    near->count = found;
}

// In place of what `list_near` left in `ways`, for each point up to WAYS neighbours, nearest first, -1
// where there are no more. Neighbours are two points of which one is among the `neighbours` nearest of
// the other. Left out are those that lie beside a nearer one, at a smaller angle than that of
// `cosine2`, the square of its cosine.
__kernel void find_neighbours(int first, int count, __global const int *place,
                        __global const float *normal, __global const float *factor, int cell,
                        uint mask, __global const int *head, __global const int *next, float scale,
                        float reach, float cosine2, __global const float *far2,
                        __global const int *far, __global int *ways)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    near_t near;
    recall_near(&near, i, ways, place, normal, factor, cell, mask, head, next, scale, reach);
    int3 p = vload3(i, place);
    float3 sight[MOST_NEAR];
    int looked = 0, found = 0;
    for (int k = 0; k < near.count; k++) {
        int j = near.number[k];
        float distance2 = near.distance2[k];
        if (nearer(far2[i], far[i], distance2, j) && nearer(far2[j], far[j], distance2, i))
            continue;
        float3 way = between(p, vload3(j, place), scale);
        bool beside = false;
        for (int s = 0; s < looked && !beside; s++) {
            float along = dot(way, sight[s]);
            beside = along > 0.0f &&
                     along * along > cosine2 * distance2 * dot(sight[s], sight[s]);
        }
        sight[looked++] = way;
        if (!beside && found < WAYS)
            ways[i * WAYS + found++] = j;
    }
    while (found < WAYS)
        ways[i * WAYS + found++] = -1;
}

// Squared distance of points listed[first..count) to their nearest within one cell, in 1/scale;
// infinity where there is none.
__kernel void nearest_distance(int first, int count, __global const int *listed,
                               __global const int *place, __global const float *normal, int cell,
                               uint mask, __global const int *head, __global const int *next,
                               float scale, __global float *nearest2)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = listed[k];
    int3 p = vload3(i, place), at = p / cell;
    float3 n = vload3(i, normal);
    float best = INFINITY, limit = cell * scale;
    FOR_POINTS(j, at - 1, at + 1)
    {
        float3 d = between(p, vload3(j, place), scale);
        if (j != i && same_sheet(n, vload3(j, normal)))
            best = fmin(best, dot(d, d));
    }
    nearest2[k] = best <= limit * limit ? best : INFINITY;
}
