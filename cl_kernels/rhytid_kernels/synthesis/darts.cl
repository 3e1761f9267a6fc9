// Darts on the surface, uniform by area: those of each triangle by a word of its own.
#include "points.clh"
#include "random.clh"

inline uint reversed(uint bits)
{
    bits = ((bits & 0x55555555u) << 1) | ((bits >> 1) & 0x55555555u);
    bits = ((bits & 0x33333333u) << 2) | ((bits >> 2) & 0x33333333u);
    bits = ((bits & 0x0f0f0f0fu) << 4) | ((bits >> 4) & 0x0f0f0f0fu);
    return as_uint(as_uchar4(bits).wzyx);
}

// Of each triangle every `parts`-th dart from number firsts[] on.  rate: darts to an area.  ends:
// where the darts of each triangle end in this throw.  phase, key: words of each.  area: of each.
// corners: a place and two sides.  normals: those of the corners.  uvs: of every triangle, UDIM
// origin and three corners from there.  A dart outside the UDIMs has triangle -1.  level: how much
// of the darts of its triangle that come before it, in darts of an even spacing of factor 1.
__kernel void throw_darts(int first, int count, uint turn, uint seed, uint parts, float rate,
                          int triangles, __global const int *ends, __global const uint *firsts,
                          __global const uint *phase, __global const uint *key,
                          __global const float *area, __global const int *index,
                          __global const int *corners, __global const float *normals,
                          __global const float8 *uvs, __global int *triangle,
                          __global int *place, __global float *normal, __global float2 *uv,
                          __global uint *priority, __global float *level)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int low = 0, high = triangles - 1;
    while (low < high) {
        int middle = (low + high) / 2;
        if (i < ends[middle])
            high = middle;
        else
            low = middle + 1;
    }
    int before = low > 0 ? ends[low - 1] : 0;
    uint number = firsts[low] + (uint)(i - before) * parts;
    uint4 r = random4(key[low], number, turn, seed);
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
    priority[i] = reversed(number + phase[low]);
    level[i] = ((float)number + unit_interval(r.x)) / (rate * area[low]);
}
