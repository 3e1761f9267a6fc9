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

// Points whose neighbours a work-item looks for together, as in edges.py; and points around them that
// wait to be looked at, eight at a time.
#define TOGETHER 8
#define CROWD 64

typedef struct {
    int count, number[CROWD], x[CROWD], y[CROWD], z[CROWD];
    float factor[CROWD], nx[CROWD], ny[CROWD], nz[CROWD];
} crowd_t;

// What gather_near keeps of the points of a crowd.
inline void keep_near(near_t *near, int most, int i, const crowd_t *crowd, __global const int *place,
                      __global const float *normal, __global const float *factor, float scale,
                      float reach)
{
    int3 p = vload3(i, place);
    float3 n = vload3(i, normal);
    int number[CROWD + 1], found = 0;
    float distance2[CROWD + 1];
    for (int m = 0; m < crowd->count; m += 8) {
        float8 x = convert_float8(vload8(0, crowd->x + m) - p.x) * scale;
        float8 y = convert_float8(vload8(0, crowd->y + m) - p.y) * scale;
        float8 z = convert_float8(vload8(0, crowd->z + m) - p.z) * scale;
        float8 far2 = x * x + y * y + z * z;
        float8 limit = 0.5f * reach * (factor[i] + vload8(0, crowd->factor + m));
        float8 facing = n.x * vload8(0, crowd->nx + m) + n.y * vload8(0, crowd->ny + m) +
                        n.z * vload8(0, crowd->nz + m);
        int8 in = (far2 <= limit * limit) & (facing > 0.0f) & (vload8(0, crowd->number + m) != i);
        int inside[8];
        float squares[8];
        vstore8(in, 0, inside);
        vstore8(far2, 0, squares);
        for (int l = 0; l < 8; l++) {
            number[found] = crowd->number[m + l];
            distance2[found] = squares[l];
            found -= inside[l];
        }
    }
    for (int m = 0; m < found; m++)
        put_near(near, most, number[m], distance2[m]);
}

// What gather_near finds of points `from` to `to`, which lie near each other.
inline void gather_together(near_t *near, int most, int from, int to, int3 low, int3 high,
                            float widest, __global const int *place,
                            __global const float *normal, __global const float *factor, int cell,
                            uint mask, __global const int *head, __global const int *next,
                            float scale, float reach)
{
    crowd_t crowd;
    crowd.count = 0;
    for (int i = from; i < to; i++)
        near[i - from].count = 0;
    FOR_POINTS(j, low / cell - 1, high / cell + 1)
    {
        int3 p = vload3(j, place);
        int around = convert_int_rtp(0.50001f * reach * (widest + factor[j]) / scale) + 1;
        if (any(p < low - around | p > high + around))
            continue;
        float3 n = vload3(j, normal);
        int m = crowd.count++;
        crowd.number[m] = j;
        crowd.x[m] = p.x;
        crowd.y[m] = p.y;
        crowd.z[m] = p.z;
        crowd.factor[m] = factor[j];
        crowd.nx[m] = n.x;
        crowd.ny[m] = n.y;
        crowd.nz[m] = n.z;
        if (crowd.count == CROWD) {
            for (int i = from; i < to; i++)
                keep_near(near + i - from, most, i, &crowd, place, normal, factor, scale, reach);
            crowd.count = 0;
        }
    }
    for (int m = crowd.count; m & 7; m++)
        crowd.factor[m] = NAN; // near to nothing
    for (int i = from; i < to; i++)
        keep_near(near + i - from, most, i, &crowd, place, normal, factor, scale, reach);
}

// In place of the first of a row of `ways`: more than WAYS points are within reach.
#define MANY -2
// Cells that are gone through for points together; of those that lie farther apart each has its own.
#define MOST_CELLS 120

// For each of `points` points those within reach, nearest first, in a row of WAYS, -1 where there are no
// more; the squared distance of the first, infinity without one. And the farthest of its `neighbours`
// nearest: its squared distance and its number; infinity where fewer are within reach.
__attribute__((vec_type_hint(float8)))
__kernel void list_near(int first, int count, int points, int neighbours, __global const int *place,
                        __global const float *normal, __global const float *factor, int cell,
                        uint mask, __global const int *head, __global const int *next, float scale,
                        float reach, __global float *nearest2, __global float *far2,
                        __global int *far, __global int *ways)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int from = k * TOGETHER, to = min(from + TOGETHER, points), most = max(neighbours, WAYS + 1);
    int3 low = vload3(from, place), high = low;
    float widest = 0.0f;
    for (int i = from; i < to; i++) {
        low = min(low, vload3(i, place));
        high = max(high, vload3(i, place));
        widest = fmax(widest, factor[i]);
    }
    int3 cells = high / cell - low / cell + 3;
    near_t near[TOGETHER];
    if (all(cells < 100) && cells.x * cells.y * cells.z <= MOST_CELLS)
        gather_together(near, most, from, to, low, high, widest, place, normal, factor, cell, mask,
                        head, next, scale, reach);
    else
        for (int i = from; i < to; i++)
            gather_near(near + i - from, most, i, place, normal, factor, cell, mask, head, next, scale,
                        reach);
    for (int i = from; i < to; i++) {
        const near_t *own = near + i - from;
        bool enough = own->count >= neighbours;
        nearest2[i] = own->count ? own->distance2[0] : INFINITY;
        far2[i] = enough ? own->distance2[neighbours - 1] : INFINITY;
        far[i] = enough ? own->number[neighbours - 1] : INT_MAX;
        for (int s = 0; s < WAYS; s++)
            ways[i * WAYS + s] = s < own->count ? own->number[s] : -1;
        if (own->count > WAYS)
            ways[i * WAYS] = MANY;
    }
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
// infinity where there is none. All points within half a cell are in the first 8 CELLS: where one is
// surely so near, the others are not looked at.
__kernel void nearest_distance(int first, int count, __global const int *listed,
                               __global const int *place, __global const float *normal, int cell,
                               uint mask, __global const int *head, __global const int *next,
                               float scale, __global float *nearest2)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = listed[k];
    int3 p = vload3(i, place);
    float3 n = vload3(i, normal);
    float best = INFINITY, limit = cell * scale, surely = 0.249f * limit * limit;
    around_t around = cells_around(p, cell);
    FOR_NEAR(j, around, part_ == 0 || best > surely, next[j])
    {
        float3 d = between(p, vload3(j, place), scale);
        if (j != i && same_sheet(n, vload3(j, normal)))
            best = fmin(best, dot(d, d));
    }
    nearest2[k] = best <= limit * limit ? best : INFINITY;
}
