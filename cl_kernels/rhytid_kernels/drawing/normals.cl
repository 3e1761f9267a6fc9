// Normal maps as codes of 16 bits, for shaders that compute x T + y B + z N with normals N and tangents T that are
// interpolated between the corners of a triangle and not made unit vectors again, B = sign N x T, as MikkTSpace asks
// for. The normal of a surface P + h n is, to first order in h, along n - g, where g is the gradient of h on the
// surface: g . dP/du = dh/du, g . dP/dv = dh/dv. (x, y, z) is the unit vector that makes the sum parallel to it.
#include "cells.clh"

// What a triangle has in a frame, made by `NormalChart.records`: the texel from which places count; the shares of the
// second and the third corner there, and what they gain to the right and down; normals and tangents of the corners;
// the unit vector along dP/du; 1 / |dP/du|, dP/dv along that vector, 1 / dP/dv across it; the sign. Both quotients are
// 0 where a triangle has no area in space.
#define FROM 0
#define SHARES 2
#define NORMALS 8
#define TANGENTS 17
#define ALONG 26
#define PER_ALONG 29
#define LEAN 30
#define PER_ACROSS 31
#define SIGN 32

#define WHITE 65535.0f

inline float3 of_corners(__global const float *vectors, float3 shares)
{
    return shares.x * vload3(0, vectors) + shares.y * vload3(1, vectors) + shares.z * vload3(2, vectors);
}

inline float3 unit_of(float3 v)
{
    return v / fmax(length(v), 1e-30f);
}

// The difference of both neighbours of a texel, or twice that to the one which may be used, over two texels.
inline float rise(__global const float *height, int step, int after, int before)
{
    float up = after ? height[step] - height[0] : 0.0f, down = before ? height[0] - height[-step] : 0.0f;
    return (up + down) / max((after ? 1 : 0) + (before ? 1 : 0), 1);
}

// A texel of which the centre lies in a triangle, or a little beyond its border, where it is as on the border.
inline float3 normal_at(__global const float *t, float along, float across, int column, int row)
{
    float right = column - t[FROM], down = row - t[FROM + 1];
    float second = t[SHARES] + right * t[SHARES + 2] + down * t[SHARES + 4];
    float third = t[SHARES + 1] + right * t[SHARES + 3] + down * t[SHARES + 5];
    float3 shares = fmax((float3)(1.0f - second - third, second, third), 0.0f);
    shares /= shares.x + shares.y + shares.z;

    float3 mean = of_corners(t + NORMALS, shares), tangent = of_corners(t + TANGENTS, shares);
    float3 axis = vload3(0, t + ALONG), normal = unit_of(mean);
    float3 first = unit_of(axis - dot(axis, normal) * normal);
    float3 direction = normal - along * first - across * t[SIGN] * cross(normal, first);

    float size = fmax(dot(mean, mean), 1e-30f), lean = dot(tangent, mean) / size;
    float3 flat = tangent - lean * mean, bitangent = t[SIGN] * cross(mean, tangent);
    float x = dot(direction, flat) / fmax(dot(flat, flat), 1e-30f);
    float y = dot(direction, bitangent) / fmax(dot(bitangent, bitangent), 1e-30f);
    return unit_of((float3)(x, y, dot(direction, mean) / size - x * lean));
}

// Of rows of a map from `row` on: heights, mesh units, from the row `before` rows above it on; triangles and codes of
// its texels, as cells.clh has these. records: `each` numbers of every triangle. green: 1 up, -1 down. out: unsigned
// codes of (n + 1) / 2, three of a texel; straight where no triangle is under its centre. Work-items: columns, rows.
// Within two codes of double, but in slivers of UV a hundred times as long as a texel and a hundredth as wide, where
// shares are rounded.
__kernel void normal_codes(__global const float *heights, __global const int *triangles,
                           __global const uchar *codes, __global const float *records, int each, int row, int before,
                           float green, __global short *out)
{
    int i = get_global_id(0), j = get_global_id(1), side = get_global_size(0), at = j * side + i;
    int code = codes[at];
    float3 n = (float3)(0.0f, 0.0f, 1.0f);
    if (code & INSIDE) {
        __global const float *t = records + triangles[at] * each;
        __global const float *height = heights + at + before * side;
        float right = side * rise(height, 1, code & RIGHT, code & LEFT);
        float up = side * rise(height, -side, code & ABOVE, code & BELOW);
        float along = right * t[PER_ALONG];
        n = normal_at(t, along, (up - t[LEAN] * along) * t[PER_ACROSS], i, row + j);
        n.y *= green;
    }
    vstore3(convert_short3(convert_int3((n * 0.5f + 0.5f) * WHITE + 0.5f)), at, out);
}
