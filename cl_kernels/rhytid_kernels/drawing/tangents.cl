// Normals and tangents of a frame, and the terms of slopes.cl: as exports/textures/tangents.py has them
// in double (normals by angles; MikkTSpace, http://www.mikktspace.com). Cosine and sine of the turn of a
// triangle are off by a few 1e-6 on the faces that they were tried on: products whose difference is small
// are subtracted exactly.
#include "slope_terms.clh"

// What takes vectors of 16, which are passed in memory.
#define INLINE inline __attribute__((always_inline))

// Of a triangle: edges in UV from the first corner to both others, texels; one over twice the area, 0 where
// there is none; from the first corner to the place that terms count from; that place; the side, 0 where UV
// are missing.
#define UV 10
#define INVERSE 4
#define OFFSET 5
#define MIDDLE 7
#define SIDE 9
// Most that a polynomial of the turn may be off in cosine or sine at the places that it is tried at.
#define CLOSE 2e-6f
// Least cosine of an angle below 0.2.
#define NEAR 0.9801f

inline float minor(float a, float b, float c, float d) // a b - c d, to two roundings
{
    float w = c * d;
    return fma(a, b, -w) + fma(-c, d, w);
}

inline float3 across(float3 a, float3 b)
{
    return (float3)(minor(a.y, b.z, a.z, b.y), minor(a.z, b.x, a.x, b.z), minor(a.x, b.y, a.y, b.x));
}

// A power of two, times which `most` is from 1 to 2.
inline float scale_of(float most)
{
    return as_float(0x7f000000 - (as_int(most) & 0x7f800000));
}

inline float3 unit(float3 v) // 0 stays 0
{
    v *= scale_of(fmax(fabs(v.x), fmax(fabs(v.y), fabs(v.z))));
    return v * (1 / sqrt(fmax(dot(v, v), FLT_MIN)));
}

// atan2 for y >= 0, to 3e-7: Abramowitz and Stegun 1964, 4.4.49. Drivers take several times as long.
inline float4 half_turn(float4 y, float4 x)
{
    float4 most = fmax(fabs(x), y), q = fmin(fabs(x), y) / fmax(most, FLT_MIN), s = q * q;
    float4 r = fma(s, (float4)0.0028662257f, (float4)-0.0161657367f);
    r = fma(s, r, (float4)0.0429096138f);
    r = fma(s, r, (float4)-0.0752896400f);
    r = fma(s, r, (float4)0.1065626393f);
    r = fma(s, r, (float4)-0.1420889944f);
    r = fma(s, r, (float4)0.1999355085f);
    r = q * fma(s, fma(s, r, (float4)-0.3333314528f), (float4)1.0f);
    r = y > fabs(x) ? M_PI_2_F - r : r;
    return x < 0 ? M_PI_F - r : r;
}

// A vector of each corner of a triangle; the last of four is nothing.
typedef struct {
    float4 x, y, z;
} corners_t;

inline corners_t corners_of(float3 a, float3 b, float3 c)
{
    return (corners_t){(float4)(a.x, b.x, c.x, 0), (float4)(a.y, b.y, c.y, 0),
                       (float4)(a.z, b.z, c.z, 0)};
}

// What `numbers` of a triangle's corners say.
inline corners_t corners_at(__global const float *vectors, __global const int *numbers, int triangle)
{
    int3 of = vload3(triangle, numbers);
    return corners_of(vload3(of.x, vectors), vload3(of.y, vectors), vload3(of.z, vectors));
}

inline float4 dots(corners_t a, corners_t b)
{
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

// From each corner to both others, times a power of two, so that no product over- or underflows.
typedef struct {
    corners_t next, last;
} edges_t;

inline edges_t edges_of(corners_t p)
{
    corners_t a = {p.x.yzxw - p.x, p.y.yzxw - p.y, p.z.yzxw - p.z};
    float4 most = fmax(fabs(a.x), fmax(fabs(a.y), fabs(a.z)));
    float scale = scale_of(fmax(most.x, fmax(most.y, most.z)));
    a = (corners_t){a.x * scale, a.y * scale, a.z * scale};
    return (edges_t){a, {-a.x.zxyw, -a.y.zxyw, -a.z.zxyw}};
}

inline float3 first_of(corners_t v)
{
    return (float3)(v.x.x, v.y.x, v.z.x);
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

inline void keep(float4 x, float4 y, float4 z, int triangle, __global float *shares)
{
    shares += 9 * triangle;
    vstore3((float3)(x.x, y.x, z.x), 0, shares);
    vstore3((float3)(x.y, y.y, z.y), 1, shares);
    vstore3((float3)(x.z, y.z, z.z), 2, shares);
}

// What each corner of a triangle adds to a normal: the triangle's own by its angle.
__kernel void normal_shares(__global const float *positions, __global const int *faces,
                            __global float *shares)
{
    int i = get_global_id(0);
    edges_t edges = edges_of(corners_at(positions, faces, i));
    float3 c = across(first_of(edges.next), first_of(edges.last)), n = unit(c);
    float4 angle = half_turn((float4)dot(n, c), dots(edges.next, edges.last));
    keep(n.x * angle, n.y * angle, n.z * angle, i, shares);
}

// What each corner adds to a tangent: dP/du in the plane of the normal, of unit length, by the angle in that
// plane. places: of each corner, whose `normals` they are.
__kernel void tangent_shares(__global const float *positions, __global const int *faces,
                             __global const int *places, __global const float *normals,
                             __global const float *uvs, __global float *shares)
{
    int i = get_global_id(0);
    __global const float *uv = uvs + UV * i;
    edges_t edges = edges_of(corners_at(positions, faces, i));
    corners_t n = corners_at(normals, places, i);
    float3 e = first_of(edges.next), f = first_of(edges.last);
    float3 c = across(e, f), a = along_of(e, f, uv);
    float4 up = fabs(n.x * c.x + n.y * c.y + n.z * c.z);
    float4 level = dots(edges.next, edges.last) - dots(edges.next, n) * dots(edges.last, n);
    float4 out = n.x * a.x + n.y * a.y + n.z * a.z;
    float4 x = a.x - out * n.x, y = a.y - out * n.y, z = a.z - out * n.z;
    float4 weight = half_turn(up, level) * rsqrt(fmax(x * x + y * y + z * z, FLT_MIN));
    weight *= fabs(uv[SIDE]);
    keep(x * weight, y * weight, z * weight, i, shares);
}

// Of each place, or vertex with a tangent of its own: the unit sum of the shares of its corners (3 triangle +
// corner), corners[firsts[i]] and those that follow.
__kernel void joined(__global const float *shares, __global const int *firsts,
                     __global const int *corners, __global float *vectors)
{
    int i = get_global_id(0);
    float3 sum = 0;
    for (int j = firsts[i]; j < firsts[i + 1]; j++)
        sum += vload3(corners[j], shares);
    vstore3(unit(sum), i, vectors);
}

// A vector over a triangle: where terms count from, and its changes over a texel along x and y.
typedef struct {
    float3 at, x, y;
} field_t;

inline field_t field(corners_t of, __global const float *uv)
{
    float3 a = first_of(of), e = (float3)(of.x.y, of.y.y, of.z.y) - a;
    float3 f = (float3)(of.x.z, of.y.z, of.z.z) - a;
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

// Cosine and sine of the angle from the axes of a triangle to those of places in it.
typedef struct {
    float16 c, s;
} turn_t;

// Shares of the corners of sixteen places.
typedef struct {
    float16 a, b, c;
} shares_t;

INLINE shares_t shares(__global const float *table)
{
    return (shares_t){vload16(0, table), vload16(1, table), vload16(2, table)};
}

INLINE float16 among(float4 of, shares_t w)
{
    return fma(w.a, (float16)of.x, fma(w.b, (float16)of.y, w.c * of.z));
}

INLINE turn_t turn_at(corners_t n, corners_t t, float3 a, float side, shares_t w)
{
    float16 nx = among(n.x, w), ny = among(n.y, w), nz = among(n.z, w);
    float16 tx = among(t.x, w), ty = among(t.y, w), tz = among(t.z, w);
    float16 size = fma(nx, nx, fma(ny, ny, nz * nz));
    float16 less = (a.x * nx + a.y * ny + a.z * nz) * fma(nx, tx, fma(ny, ty, nz * tz));
    float16 c = fma(a.x * tx + a.y * ty + a.z * tz, size, -less);
    float16 s = nx * (a.y * tz - a.z * ty) + ny * (a.z * tx - a.x * tz) + nz * (a.x * ty - a.y * tx);
    s *= side * sqrt(size);
    float16 norm = rsqrt(fma(c, c, fma(s, s, (float16)1e-30f)));
    return (turn_t){c * norm, s * norm};
}

// Angles below 0.2 from the last of sixteen turns.
INLINE float16 angles(turn_t at)
{
    float16 v = at.s * at.c.sf - at.c * at.s.sf, s = v * v;
    return v * fma(s, fma(s, fma(s, (float16)0.0446428571f, (float16)0.075f), (float16)0.166666667f),
                   (float16)1.0f);
}

// A form in x and y (coefficients of x^n, x^(n - 1) y, ..) times by.x x + by.y y.
INLINE float8 times(float8 form, float2 by)
{
    return fma(form, (float8)by.x, by.y * (float8)(0, form.s0123, form.s456));
}

// A polynomial of fourth degree in u and v (1, u, v, uu, uv, vv, ..) as one of x and y, as POLYNOMIAL has it;
// u = along.x x + along.y y, v = aside.x x + aside.y y.
INLINE void substituted(float16 of, float2 along, float2 aside, __global float *out)
{
    const float8 one = {1, 0, 0, 0, 0, 0, 0, 0};
    float8 v = times(one, aside), vv = times(v, aside), vvv = times(vv, aside);
    float8 a = times(of.s1 * one, along) + of.s2 * v;
    float8 b = times(times(of.s3 * one, along) + of.s4 * v, along) + of.s5 * vv;
    float8 c = times(times(of.s6 * one, along) + of.s7 * v, along) + of.s8 * vv;
    float8 d = times(times(of.sa * one, along) + of.sb * v, along) + of.sc * vv;
    c = times(c, along) + of.s9 * vvv;
    d = times(times(d, along) + of.sd * vvv, along) + of.se * times(vvv, aside);
    vstore8((float8)(of.s0, a.s1, b.s2, c.s3, d.s4, a.s0, b.s1, c.s2), 0, out);
    vstore4((float4)(d.s3, b.s0, c.s1, d.s2), 2, out);
    vstore3((float3)(c.s0, d.s1, d.s0), 4, out);
}

// From rises over texels to slopes along the axes of a triangle: PER_ALONG, ACROSS, LEAN.
typedef struct {
    float per_along, across, lean;
} metric_t;

// The turn of a triangle as slopes.cl has it, after its angle in 15 places, and whether it is close to the exact
// one in 16 others. table: FITTED of pipeline/tangents.py.
INLINE bool fit(corners_t n, corners_t t, float3 a, metric_t m, __global const float *uv,
                __global const float *table, __global float *out)
{
    turn_t at = turn_at(n, t, a, uv[SIDE], shares(table));
    float angle[16];
    vstore16(angles(at), 0, angle);
    float16 sum = 0;
    for (int k = 0; k < 15; k++)
        sum = fma((float16)angle[k], vload16(6 + k, table), sum);
    substituted(sum, (float2)(uv[3], -uv[2]) * uv[INVERSE], (float2)(-uv[1], uv[0]) * uv[INVERSE],
                out + POLYNOMIAL);
    out[AXES] = m.per_along * (at.c.sf - at.s.sf * m.lean);
    out[AXES + 1] = m.per_along * at.s.sf * m.across;
    out[AXES + 2] = -m.per_along * fma(at.c.sf, m.lean, at.s.sf);
    out[AXES + 3] = m.per_along * at.c.sf * m.across;
    shares_t w = shares(table + 48);
    turn_t wanted = turn_at(n, t, a, uv[SIDE], w);
    float16 x = fma(w.b - 1.0f / 3, (float16)uv[0], (w.c - 1.0f / 3) * uv[2]);
    float16 y = fma(w.b - 1.0f / 3, (float16)uv[1], (w.c - 1.0f / 3) * uv[3]);
    POLYNOMIAL_OF(float16, out, y);
    float16 turn = POLYNOMIAL_AT(float16, x, );
    SMALL_TURN(float16, turn, c, s);
    float16 off = fmax(fabs(c * at.c.sf - s * at.s.sf - wanted.c),
                       fabs(s * at.c.sf + c * at.s.sf - wanted.s));
    return all(at.c * at.c.sf + at.s * at.s.sf > NEAR) && all(off < CLOSE);
}

// Terms of the exact turn.
inline void exact(corners_t n, corners_t t, float3 a, metric_t m, __global const float *uv,
                  __global float *out)
{
    out[PER_ALONG] = m.per_along;
    out[ACROSS] = m.across;
    out[LEAN] = m.lean;
    field_t normal = field(n, uv), tangent = field(t, uv);
    field_t turned = {cross(a, tangent.at), cross(a, tangent.x), cross(a, tangent.y)};
    scalar_product(a, tangent, out + ALONG_T);
    scalar_product(a, normal, out + ALONG_N);
    product(tangent, normal, 1, out + T_ON_N);
    product(normal, normal, 1, out + N_ON_N);
    product(turned, normal, uv[SIDE], out + TURNED);
}

// places, vertices: of corners, whose `normals` and `tangents` they are.
__kernel void terms(__global const float *positions, __global const int *faces,
                    __global const int *places, __global const int *vertices,
                    __global const float *normals, __global const float *tangents,
                    __global const float *uvs, __global const float *table, __global float *terms)
{
    int i = get_global_id(0);
    __global const float *uv = uvs + UV * i;
    __global float *out = terms + TERMS * i;
    int3 of = vload3(i, faces);
    float3 p = vload3(of.x, positions), e = vload3(of.y, positions) - p;
    float3 f = vload3(of.z, positions) - p, a = along_of(e, f, uv), c = across(e, f);
    float du = length(rise_x(e, f, uv)) * fabs(uv[INVERSE]);
    float dv = du > 0 ? sqrt(dot(c, c)) * fabs(uv[INVERSE]) / du : 0; // |dP/du x dP/dv| over |dP/du|
    float lean = dot(rise_y(e, f, uv), a) * uv[INVERSE];
    bool flat = !(du > 0 && dv > 0); // without an area in space it is taken as flat
    metric_t m = {flat ? 0 : 0.5f / du, flat ? 0 : du / dv, flat ? 0 : lean / dv};
    out[FROM_X] = uv[MIDDLE];
    out[FROM_Y] = uv[MIDDLE + 1];
    out[CENTROID_X] = (uv[0] + uv[2]) / 3 - uv[OFFSET];
    out[CENTROID_Y] = (uv[1] + uv[3]) / 3 - uv[OFFSET + 1];
    corners_t n = corners_at(normals, places, i), t = corners_at(tangents, vertices, i);
    out[FITS] = fit(n, t, a, m, uv, table, out);
    if (out[FITS] == 0)
        exact(n, t, a, m, uv, out);
}
