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

// Points, and edges, that wait to be looked at together: which of them count no processor can guess.
#define NEAR 64

// Points near the edges of a pore. Places are in arrays of their own, to be looked at eight at a time.
typedef struct {
    int count, number[NEAR], x[NEAR], y[NEAR], z[NEAR];
} near_t;

// Where the ends of edges lie that are no longer than e and cross it.
typedef struct {
    int a, b;
    int3 low, high;
} box_t;

inline box_t box_of(int e, __global const int *nodes, __global const float *length,
                    __global const int *place, float unit)
{
    box_t box;
    box.a = nodes[2 * e];
    box.b = nodes[2 * e + 1];
    int3 p = vload3(box.a, place), q = vload3(box.b, place);
    int around = convert_int_rtp(length[e] / unit);
    box.low = max(sub_sat(min(p, q), (int3)(around)), 0); // beyond these nothing lies
    box.high = min(add_sat(max(p, q), (int3)(around)), 1 << 30);
    return box;
}

// The points in a box, without those of its edge. Returns how many there are. Those that fill up the
// last eight lie in no box.
inline int points_in(const near_t *near, const box_t *box, int *found)
{
    int count = 0;
    for (int m = 0; m < near->count; m += 8) {
        int8 x = vload8(0, near->x + m), y = vload8(0, near->y + m), z = vload8(0, near->z + m);
        int8 number = vload8(0, near->number + m);
        int8 in = x >= box->low.x & x <= box->high.x & y >= box->low.y & y <= box->high.y &
                  z >= box->low.z & z <= box->high.z & number != box->a & number != box->b;
        int inside[8];
        vstore8(in, 0, inside);
        for (int l = 0; l < 8; l++) {
            found[count] = near->number[m + l];
            count -= inside[l];
        }
    }
    return count;
}

// The crossings of edges `from` to `to`, counted from `start` on, with edges that end at points near
// them.
inline void cross_near(near_t *near, int from, int to, int start, __global const int *nodes,
                       __global const float *length, __global const int *offsets,
                       __global const int *edges, __global const int *others,
                       __global const int *place, __global const float *normal, float unit,
                       float scale, __global int *found, __global int *much)
{
    for (int l = near->count; l & 7; l++)
        near->x[l] = -1;
    for (int k = from; k < to; k++) {
        int e = start + k, ends[NEAR + 1], some[NEAR], waiting = 0, total = much[k];
        box_t box = box_of(e, nodes, length, place, unit);
        float own = length[e];
        int points = points_in(near, &box, ends);
        for (int m = 0; m < points; m++) {
            int c = ends[m];
            for (int h = offsets[c]; h < offsets[c + 1]; h++) {
                int f = edges[h], d = others[h];
                int3 there = vload3(d, place);
                bool longer = (length[f] > own) | ((length[f] == own) & (f > e));
                some[waiting] = f;
                // Where both ends are near, the lower one finds the edge.
                bool from_d = (d < c) & all(there >= box.low & there <= box.high);
                waiting += !(longer | (d == box.a) | (d == box.b) | from_d);
                if (waiting == NEAR) {
                    total = add_partners(some, waiting, e, nodes, place, normal, scale, k, total,
                                         found);
                    waiting = 0;
                }
            }
        }
        much[k] = add_partners(some, waiting, e, nodes, place, normal, scale, k, total, found);
    }
}

// The hint keeps compilers from taking several edges at once in one vector: they go through lists of
// different lengths, and Intel's for processors takes seven times as long that way.
// found: for each of `count` edges from number `start` on its partners that are no longer, at most
// CROSSINGS, ascending; much: how many there are. Edges are in the order of their first pores: the
// work-item of the first of a pore goes through the points around all of them once.
__attribute__((vec_type_hint(float4)))
__kernel void find_crossings(int first, int count, int start, __global const int *nodes,
                             __global const float *length, __global const int *offsets,
                             __global const int *edges, __global const int *others,
                             __global const int *place, __global const float *normal, float unit,
                             float scale, int cell, uint mask, __global const int *head,
                             __global const int *next, __global int *found, __global int *much)
{
    int k = first + get_global_id(0), to = k + 1;
    if (k >= count || (k > 0 && nodes[2 * (start + k - 1)] == nodes[2 * (start + k)]))
        return;
    box_t all_of = box_of(start + k, nodes, length, place, unit);
    much[k] = 0;
    for (; to < count && nodes[2 * (start + to)] == all_of.a; to++) {
        box_t box = box_of(start + to, nodes, length, place, unit);
        all_of.low = min(all_of.low, box.low);
        all_of.high = max(all_of.high, box.high);
        much[to] = 0;
    }
    near_t near;
    near.count = 0;
    FOR_POINTS(c, all_of.low / cell, all_of.high / cell)
    {
        int3 p = vload3(c, place);
        near.number[near.count] = c;
        near.x[near.count] = p.x;
        near.y[near.count] = p.y;
        near.z[near.count] = p.z;
        if (++near.count == NEAR) {
            cross_near(&near, k, to, start, nodes, length, offsets, edges, others, place, normal,
                       unit, scale, found, much);
            near.count = 0;
        }
    }
    cross_near(&near, k, to, start, nodes, length, offsets, edges, others, place, normal, unit,
               scale, found, much);
}
