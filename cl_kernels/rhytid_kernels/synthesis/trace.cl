// Follows the straight line of each edge across the triangles of the map (charts.py has the same in
// double). Corners are taken relative to the start, so that rounding is that of the line itself.
#include "points.clh"

#define BORDER (-1)

inline float cross2(float2 a, float2 b)
{
    return a.x * b.y - a.y * b.x;
}

// uvs: UDIM origin and three corners from there.  across: the triangle beyond each side.
// jacobians: dX/du and dX/dv.  middle: the triangle of the midpoint, BORDER where the line leaves
// the map, ends elsewhere, takes more than `detour` times the distance, or has its middle where
// nothing is carried.
__kernel void trace_edges(int first, int count, __global const int *nodes,
                          __global const float *length, __global const float2 *uv,
                          __global const int *triangle, __global const float8 *uvs,
                          __global const int *across, __global const float *jacobians,
                          __global const uchar *carries, int longest, float detour,
                          __global int *middle)
{
    int e = first + get_global_id(0);
    if (e >= count)
        return;
    float2 origin = uv[nodes[2 * e]], step = uv[nodes[2 * e + 1]] - origin;
    int t = triangle[nodes[2 * e]], came_from = BORDER, half_way = BORDER;
    float share = 0.0f, travelled = 0.0f;
    for (int k = 0; k < longest; k++) {
        float8 map = uvs[t];
        float2 o = origin - map.s01;
        float2 corner[3] = {map.s23 - o, map.s45 - o, map.s67 - o};
        float turn = sign(cross2(corner[1] - corner[0], corner[2] - corner[1]));
        float leaves = INFINITY;
        int following = BORDER;
        for (int s = 0; s < 3; s++) {
            float2 side = corner[(s + 1) % 3] - corner[s];
            float outward = turn * cross2(step, side);
            int beyond = across[3 * t + s];
            if (outward > 0.0f && (beyond != came_from || beyond == BORDER)) {
                float where = turn * cross2(corner[s], side) / outward;
                following = where < leaves ? beyond : following;
                leaves = fmin(leaves, where);
            }
        }
        if (isinf(leaves)) { // slipped through a corner by rounding: it ends here
            leaves = 0.0f;
            following = BORDER;
        }
        leaves = clamp(leaves, share, 1.0f);
        float3 vector = vload3(2 * t, jacobians) * step.x + vload3(2 * t + 1, jacobians) * step.y;
        travelled += (leaves - share) * sqrt(dot(vector, vector));
        half_way = share <= 0.5f && leaves >= 0.5f ? t : half_way;
        share = leaves;
        if (share >= 1.0f || following == BORDER)
            break;
        came_from = t;
        t = following;
    }
    bool whole = share == 1.0f && t == triangle[nodes[2 * e + 1]] && any(step != 0.0f) &&
                 travelled <= detour * length[e] && half_way != BORDER && carries[half_way];
    middle[e] = whole ? half_way : BORDER;
}
