// Darts on the surface, uniform by weight: one stratum of the surface each, in its order.
#include "points.clh"
#include "random.clh"

// ends: where the stretch of each triangle ends on [0, 2^32).  corners: a place and two sides.
// normals: those of the corners.  uvs: of every triangle, UDIM origin and three corners from there.
// A dart outside the UDIMs has triangle -1.
__kernel void throw_darts(int first, int count, uint start, uint total, uint round, uint seed,
                          int triangles, __global const uint *ends, __global const int *index,
                          __global const int *corners, __global const float *normals,
                          __global const float8 *uvs, __global int *triangle,
                          __global int *place, __global float *normal, __global float2 *uv,
                          __global uint *priority)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    uint4 r = random4(start + i, round, seed, 0u);
    uint target = stratum(start + i, r.x, total);
    int low = 0, high = triangles - 1;
    while (low < high) {
        int middle = (low + high) / 2;
        if (target < ends[middle])
            high = middle;
        else
            low = middle + 1;
    }
    // Barycentric coordinates in units of 2^-31; the half beyond the diagonal is folded back.
    uint a = r.y >> 1, b = r.z >> 1, one = 1u << 31;
    if (a + b > one) {
        a = one - a;
        b = one - b;
    }
    long3 side1 = convert_long3(vload3(3 * low + 1, corners));
    long3 side2 = convert_long3(vload3(3 * low + 2, corners));
    int3 offset = convert_int3((side1 * (long)a + side2 * (long)b) >> 31);
    vstore3(vload3(3 * low, corners) + offset, i, place);
    float s = a * 0x1p-31f, t = b * 0x1p-31f;
    float8 map = uvs[index[low]];
    float2 at = map.s01 + (map.s23 + ((map.s45 - map.s23) * s + (map.s67 - map.s23) * t));
    bool inside = at.x >= 0.0f && at.y >= 0.0f && at.x < 10.0f;
    triangle[i] = inside ? index[low] : -1;
    uv[i] = at;
    vstore3(vload3(3 * low, normals) * (1.0f - s - t) + vload3(3 * low + 1, normals) * s +
                vload3(3 * low + 2, normals) * t,
            i, normal);
    priority[i] = r.w;
}
