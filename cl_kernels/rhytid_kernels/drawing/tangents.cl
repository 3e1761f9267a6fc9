// Normals and tangents of a frame, and the terms of slopes.cl: as exports/textures/tangents.py has them
// in double (normals by angles; MikkTSpace, http://www.mikktspace.com). Cosine and sine of the turn of a
// triangle are off by a few 1e-6 on the faces that they were tried on: products whose difference is small
// are subtracted exactly.
#include "slope_terms.clh"

// Of a triangle: edges in UV from the first corner to both others, texels; one over twice the area, 0 where
// there is none; from the first corner to the place that terms count from; that place; the side, 0 where UV
// are missing.
#define UV 10
#define INVERSE 4
#define OFFSET 5
#define MIDDLE 7
#define SIDE 9
// Of what a rate of change per texel is a share at most, where a cubic is close enough over 16 texels.
#define MOST_RATE 0.015f

inline float minor(float a, float b, float c, float d) // a b - c d, to two roundings
{
    float w = c * d;
    return fma(a, b, -w) + fma(-c, d, w);
}

inline float3 across(float3 a, float3 b)
{
    return (float3)(minor(a.y, b.z, a.z, b.y), minor(a.z, b.x, a.x, b.z), minor(a.x, b.y, a.y, b.x));
}

// Times a power of two, so that the largest component is from 1 to 2 and no square over- or underflows.
inline float3 scaled(float3 v)
{
    float most = fmax(fabs(v.x), fmax(fabs(v.y), fabs(v.z)));
    return v * as_float(0x7f000000 - (as_int(most) & 0x7f800000));
}

inline float3 unit(float3 v) // 0 stays 0
{
    v = scaled(v);
    return v * (1 / sqrt(fmax(dot(v, v), FLT_MIN)));
}

// atan2 for y >= 0, to 3e-7: Abramowitz and Stegun 1964, 4.4.49. Drivers take several times as long.
inline float half_turn(float y, float x)
{
    float most = fmax(fabs(x), y), q = fmin(fabs(x), y) / fmax(most, FLT_MIN), s = q * q;
    float r = fma(s, 0.0028662257f, -0.0161657367f);
    r = fma(s, r, 0.0429096138f);
    r = fma(s, r, -0.0752896400f);
    r = fma(s, r, 0.1065626393f);
    r = fma(s, r, -0.1420889944f);
    r = fma(s, r, 0.1999355085f);
    r = q * fma(s, fma(s, r, -0.3333314528f), 1.0f);
    r = y > fabs(x) ? M_PI_2_F - r : r;
    return x < 0 ? M_PI_F - r : r;
}

inline float angle(float3 a, float3 b)
{
    a = scaled(a);
    b = scaled(b);
    float3 c = across(a, b);
    return half_turn(sqrt(dot(c, c)), dot(a, b));
}

inline float3 flattened(float3 v, float3 normal)
{
    return v - dot(v, normal) * normal;
}

// Corner `k` of a triangle, counted on from the last.
inline float3 corner(__global const float *positions, __global const int *faces, int triangle, int k)
{
    return vload3(faces[3 * triangle + k % 3], positions);
}

// dP of a triangle with edges e and f over a texel along x, times twice its area in UV.
inline float3 rise_x(float3 e, float3 f, __global const float *uv)
{
    return (float3)(minor(e.x, uv[3], f.x, uv[1]), minor(e.y, uv[3], f.y, uv[1]),
                    minor(e.z, uv[3], f.z, uv[1]));
}

inline float3 rise_y(float3 e, float3 f, __global const float *uv)
{
    return (float3)(minor(f.x, uv[0], e.x, uv[2]), minor(f.y, uv[0], e.y, uv[2]),
                    minor(f.z, uv[0], e.z, uv[2]));
}

// Unit dP/du.
inline float3 along_of(float3 e, float3 f, __global const float *uv)
{
    return unit(rise_x(e, f, uv) * sign(uv[INVERSE]));
}

// Of each place, from the corners (3 triangle + corner) corners[firsts[i]] on: the unit mean of the triangles'
// normals by their angles.
__kernel void normals(__global const float *positions, __global const int *faces,
                      __global const int *firsts, __global const int *corners,
                      __global float *normals)
{
    int i = get_global_id(0);
    float3 sum = 0;
    for (int j = firsts[i]; j < firsts[i + 1]; j++) {
        int triangle = corners[j] / 3, k = corners[j] % 3;
        float3 p = corner(positions, faces, triangle, k);
        float3 e = corner(positions, faces, triangle, k + 1) - p;
        float3 f = corner(positions, faces, triangle, k + 2) - p;
        sum += unit(across(e, f)) * angle(e, f);
    }
    vstore3(unit(sum), i, normals);
}

// Of each vertex with a tangent of its own: dP/du of its triangles, in the plane of the normal, of unit
// length, by their angles in that plane. places: of each corner.
__kernel void tangents(__global const float *positions, __global const int *faces,
                       __global const int *places, __global const float *normals,
                       __global const float *uvs, __global const int *firsts,
                       __global const int *corners, __global float *tangents)
{
    int i = get_global_id(0);
    float3 sum = 0;
    for (int j = firsts[i]; j < firsts[i + 1]; j++) {
        int triangle = corners[j] / 3, k = corners[j] % 3;
        __global const float *uv = uvs + UV * triangle;
        float3 n = vload3(places[corners[j]], normals), p = corner(positions, faces, triangle, k);
        float3 e = corner(positions, faces, triangle, k + 1) - p;
        float3 f = corner(positions, faces, triangle, k + 2) - p;
        float3 first = corner(positions, faces, triangle, 0);
        float3 along = along_of(corner(positions, faces, triangle, 1) - first,
                                corner(positions, faces, triangle, 2) - first, uv);
        if (uv[SIDE] != 0)
            sum += unit(flattened(along, n)) * angle(flattened(e, n), flattened(f, n));
    }
    vstore3(unit(sum), i, tangents);
}

// A vector over a triangle: where terms count from, and its changes over a texel along x and y.
typedef struct {
    float3 at, x, y;
} field_t;

inline field_t field(float3 a, float3 b, float3 c, __global const float *uv)
{
    float3 e = b - a, f = c - a;
    float3 x = rise_x(e, f, uv) * uv[INVERSE], y = rise_y(e, f, uv) * uv[INVERSE];
    float3 at = a + uv[OFFSET] * x + uv[OFFSET + 1] * y;
    return (field_t){uv[INVERSE] != 0 ? at : 0, x, y};
}

inline void scalar_product(float3 with, field_t of, __global float *t)
{
    t[0] = dot(with, of.at);
    t[1] = dot(with, of.x);
    t[2] = dot(with, of.y);
}

inline void product(field_t a, field_t b, float sign, __global float *t)
{
    t[0] = sign * dot(a.at, b.at);
    t[1] = sign * (dot(a.at, b.x) + dot(a.x, b.at));
    t[2] = sign * (dot(a.at, b.y) + dot(a.y, b.at));
    t[3] = sign * dot(a.x, b.x);
    t[4] = sign * (dot(a.x, b.y) + dot(a.y, b.x));
    t[5] = sign * dot(a.y, b.y);
}

inline float farthest(float3 a, float3 b, float3 c, float3 from)
{
    return fmax(distance(a, from), fmax(distance(b, from), distance(c, from)));
}

// Whether a cubic along x is close to the turn: by how far, in texels, the nearest place is at which n, or a or
// T in its plane, would vanish. A function of such poles has a fourth derivative below 24 rate^4.
inline float smooth(field_t n, field_t t, float3 a, float off_n, float off_t, float3 n0, float3 t0)
{
    float least_a = length(cross(a, n0)) - off_n;
    float least_t = length(cross(t0, n0)) - off_n * length(t0) - off_t * length(n0) - off_n * off_t;
    float rate = length(n.x) / least_a + (length(t.x) + length(n.x)) / least_t;
    return least_a > 0 && least_t > 0 && rate < MOST_RATE;
}

// places, vertices: of corners, whose `normals` and `tangents` they are.
__kernel void terms(__global const float *positions, __global const int *faces,
                    __global const int *places, __global const int *vertices,
                    __global const float *normals, __global const float *tangents,
                    __global const float *uvs, __global float *terms)
{
    int i = get_global_id(0);
    __global const float *uv = uvs + UV * i;
    __global float *out = terms + TERMS * i;
    float3 p = corner(positions, faces, i, 0), e = corner(positions, faces, i, 1) - p;
    float3 f = corner(positions, faces, i, 2) - p, a = along_of(e, f, uv), n[3], t[3];
    for (int k = 0; k < 3; k++) {
        n[k] = vload3(places[3 * i + k], normals);
        t[k] = vload3(vertices[3 * i + k], tangents);
    }
    field_t normal = field(n[0], n[1], n[2], uv), tangent = field(t[0], t[1], t[2], uv);
    field_t turned = {cross(a, tangent.at), cross(a, tangent.x), cross(a, tangent.y)};
    scalar_product(a, tangent, out + ALONG_T);
    scalar_product(a, normal, out + ALONG_N);
    product(tangent, normal, 1, out + T_ON_N);
    product(normal, normal, 1, out + N_ON_N);
    product(turned, normal, uv[SIDE], out + TURNED);
    float3 c = across(e, f);
    float du = length(rise_x(e, f, uv)) * fabs(uv[INVERSE]);
    float dv = du > 0 ? sqrt(dot(c, c)) * fabs(uv[INVERSE]) / du : 0; // |dP/du x dP/dv| over |dP/du|
    float lean = dot(rise_y(e, f, uv), a) * uv[INVERSE];
    bool flat = !(du > 0 && dv > 0); // without an area in space it is taken as flat
    out[PER_ALONG] = flat ? 0 : 0.5f / du;
    out[ACROSS] = flat ? 0 : du / dv;
    out[LEAN] = flat ? 0 : lean / dv;
    out[FROM_X] = uv[MIDDLE];
    out[FROM_Y] = uv[MIDDLE + 1];
    float3 n0 = (n[0] + n[1] + n[2]) / 3, t0 = (t[0] + t[1] + t[2]) / 3;
    out[SMOOTH] = smooth(normal, tangent, a, farthest(n[0], n[1], n[2], n0),
                         farthest(t[0], t[1], t[2], t0), n0, t0);
}
