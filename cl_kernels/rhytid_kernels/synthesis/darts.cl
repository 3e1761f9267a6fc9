// Darts on the surface, uniform by area: those of each triangle by a word of its own.
#include "rooms.clh"
#include "random.clh"

inline uint reversed(uint bits)
{
    bits = ((bits & 0x55555555u) << 1) | ((bits >> 1) & 0x55555555u);
    bits = ((bits & 0x33333333u) << 2) | ((bits >> 2) & 0x33333333u);
    bits = ((bits & 0x0f0f0f0fu) << 4) | ((bits >> 4) & 0x0f0f0f0fu);
    return as_uint(as_uchar4(bits).wzyx);
}

// A dart of the row-th triangle, its number there, and a random word.
typedef struct {
    int row;
    uint number, word;
    int3 place;
    float3 normal;
    float2 uv;
} dart_t;

// The triangle of the i-th dart of a throw.  ends: where the darts of each triangle end in it.
inline int row_of(int i, int triangles, __global const int *ends)
{
    int low = 0, high = triangles - 1;
    while (low < high) {
        int middle = (low + high) / 2;
        if (i < ends[middle])
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

// Of each triangle every `parts`-th dart from number firsts[] on; this is the i-th of all, in triangle
// `row`.  key: a word of each.  corners: a place and two sides.  normals: those of the corners.  uvs:
// of every triangle, UDIM origin and three corners from there; index: which of them.
inline dart_t dart_of(int i, int row, uint turn, uint seed, uint parts,
                      __global const int *ends, __global const uint *firsts,
                      __global const uint *key, __global const int *index,
                      __global const int *corners, __global const float *normals,
                      __global const float8 *uvs)
{
    dart_t dart;
    dart.row = row;
    int before = row > 0 ? ends[row - 1] : 0;
    dart.number = firsts[row] + (uint)(i - before) * parts;
    uint4 r = random4(key[row], dart.number, turn, seed);
    dart.word = r.x;
    // Barycentric coordinates in units of 2^-31; the half beyond the diagonal is folded back.
    uint a = r.y >> 1, b = r.z >> 1, one = 1u << 31;
    if (a + b > one) {
        a = one - a;
        b = one - b;
    }
    long3 side1 = convert_long3(vload3(3 * row + 1, corners));
    long3 side2 = convert_long3(vload3(3 * row + 2, corners));
    int3 offset = convert_int3((side1 * (long)a + side2 * (long)b) >> 31);
    dart.place = vload3(3 * row, corners) + offset;
    float s = a * 0x1p-31f, t = b * 0x1p-31f;
    float8 map = uvs[index[row]];
    dart.uv = map.s01 + (map.s23 + ((map.s45 - map.s23) * s + (map.s67 - map.s23) * t));
    dart.normal = vload3(3 * row, normals) * (1.0f - s - t) + vload3(3 * row + 1, normals) * s +
                  vload3(3 * row + 2, normals) * t;
    return dart;
}

inline bool within_udims(float2 uv)
{
    return uv.x >= 0.0f && uv.y >= 0.0f && uv.x < 10.0f;
}

// How much of the darts of its triangle come before one, in darts of an even spacing of factor 1.
inline float level_of(const dart_t *dart, float rate, __global const float *area)
{
    return ((float)dart->number + unit_interval(dart->word)) / (rate * area[dart->row]);
}

// Darts of a throw that a work-item looks at, as in pores.py.
#define TOGETHER 8

// may: 0 for a dart that does not count, or that a pore is too close to, whatever its factor. least: of
// each triangle what no factor there is below.  all: darts of the throw. Other arguments as of
// throw_darts and find_room.
__kernel void sift_darts(int first, int count, int all, uint turn, uint seed, uint parts, float rate,
                         int triangles, __global const int *ends, __global const uint *firsts,
                         __global const uint *key, __global const float *area,
                         __global const int *index, __global const int *corners,
                         __global const float *normals, __global const float8 *uvs,
                         __global const float *least, int cell, uint mask,
                         __global const int *starts, __global const int *numbers, int most,
                         float scale, __global uchar *may)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    pores_t pores = {mask, starts, numbers, most, scale};
    int row = row_of(k * TOGETHER, triangles, ends);
    for (int i = k * TOGETHER; i < min((k + 1) * TOGETHER, all); i++) {
        while (i >= ends[row])
            row++;
        dart_t dart = dart_of(i, row, turn, seed, parts, ends, firsts, key, index, corners, normals,
                              uvs);
        float factor = least[row];
        may[i] = within_udims(dart.uv) && counts(level_of(&dart, rate, area), factor) &&
                 has_room(dart.place, dart.normal, factor, cell, &pores);
    }
}

// Of the darts of a throw those listed.  rate: darts to an area.  phase: a word of each triangle.
// area: of each.  Other arguments as of dart_of.  A dart outside the UDIMs has triangle -1.
__kernel void throw_darts(int first, int count, uint turn, uint seed, uint parts, float rate,
                          int triangles, __global const int *ends, __global const uint *firsts,
                          __global const uint *key, __global const float *area,
                          __global const int *index, __global const int *corners,
                          __global const float *normals, __global const float8 *uvs,
                          __global const uint *phase, __global const int *listed,
                          __global int *triangle, __global int *place, __global float *normal,
                          __global float2 *uv, __global uint *priority, __global float *level)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    int i = listed[k];
    dart_t dart = dart_of(i, row_of(i, triangles, ends), turn, seed, parts, ends, firsts, key, index,
                          corners, normals, uvs);
    triangle[k] = within_udims(dart.uv) ? index[dart.row] : -1;
    vstore3(dart.place, k, place);
    vstore3(dart.normal, k, normal);
    uv[k] = dart.uv;
    priority[k] = reversed(dart.number + phase[dart.row]);
    level[k] = level_of(&dart, rate, area);
}
