// Slopes of the relief on the surface, and their products: the moments that level 0 has (Olano and Baker
// 2010, "LEAN mapping", eq. 7 to 9). Level 1 is the mean of 2 x 2 texels, added as level.cl adds them.
//
// A slope is a length over a length, along T and B of the texel: T is MikkTSpace's tangent in the plane of
// the interpolated normal n, B = sign n x T. The triangle's own axes, dP/du and what is across it, are
// turned into that plane, as exports/textures/writers.py has it for normal maps. The angle between both is
// atan2(s, c) with c = (a.T) (n.n) - (a.n) (T.n) and s = sign |n| n.(a x T), where a is the unit dP/du: each
// product is a polynomial of the place in the triangle, because n and T are linear there.
#include "vectors.clh"

// Of a triangle, see pipeline/slopes.py: coefficients of a.T and a.n (1, x, y), of T.n, n.n and
// sign n.(a x T) (1, x, y, xx, xy, yy), texels per mesh unit along and across, the lean of one on the
// other, and the place that x and y are counted from, texels.
#define TERMS 32
#define ALONG_T 0
#define ALONG_N 3
#define T_ON_N 6
#define N_ON_N 12
#define TURNED 18
#define PER_ALONG 24
#define PER_ACROSS 25
#define LEAN 26
#define FROM_X 27
#define FROM_Y 28
// Bits of a code: which neighbours a difference may use, and whether a triangle is under the texel.
#define RIGHT 1
#define LEFT 2
#define ABOVE 4
#define BELOW 8
#define INSIDE 16
#define ALL 31
#define COUNTS(bit) convert_float16((code & (uchar)bit) != (uchar)0 ? (uchar16)1 : (uchar16)0)

typedef struct {
    float16 x, y;
} slopes_t;

inline float16 linear(__global const float *t, float16 x, float y)
{
    return x * t[1] + (t[0] + t[2] * y);
}

inline float16 quadratic(__global const float *t, float16 x, float y)
{
    return x * (x * t[3] + (t[1] + t[4] * y)) + (t[0] + (t[2] + t[5] * y) * y);
}

// As if every texel lay in one triangle. rises: of the heights over one texel, right and up, mesh units.
// x, y: of the first texel, in texels from the lower left of UDIM 1001.
inline slopes_t slopes_in(__global const float *t, slopes_t rises, float x, float y)
{
    const float16 lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    float16 at = lane + (x - t[FROM_X]);
    y -= t[FROM_Y];
    float16 size = quadratic(t + N_ON_N, at, y);
    float16 c = linear(t + ALONG_T, at, y) * size -
                linear(t + ALONG_N, at, y) * quadratic(t + T_ON_N, at, y);
    float16 s = quadratic(t + TURNED, at, y) * sqrt(size);
    float16 norm = rsqrt(fmax(c * c + s * s, 1e-30f));
    float16 along = rises.x * t[PER_ALONG], across = rises.y * t[PER_ACROSS] - along * t[LEAN];
    return (slopes_t){(c * along + s * across) * norm, (c * across - s * along) * norm};
}

// Rises over one texel, right and up, of a vector at `p` in rows of `stride` heights: half the difference of
// both neighbours, or that to the one that may be used.
inline slopes_t rises_of(__global const float *p, int stride, uchar16 code)
{
    float16 left = vload16(0, p - 1), right = vload16(0, p + 1);
    float16 above = vload16(0, p - stride), below = vload16(0, p + stride);
    if (all(code == (uchar16)ALL))
        return (slopes_t){0.5f * (right - left), 0.5f * (above - below)};
    float16 here = vload16(0, p);
    float16 r = COUNTS(RIGHT), l = COUNTS(LEFT), a = COUNTS(ABOVE), b = COUNTS(BELOW);
    return (slopes_t){(r * (right - here) + l * (here - left)) / fmax(r + l, 1.0f),
                      (a * (above - here) + b * (here - below)) / fmax(a + b, 1.0f)};
}

// What a kernel reads. heights: rows of `stride`, mesh units, with one texel around them; the first of them
// is `first`. codes, firsts, members: of a strip of the map, which has `vectors` vectors per row; the first
// of them is `corner`, whose first texel is at `x`, `y`. terms: of each triangle.
#define SURFACE                                                                                \
    __global const float *heights, int stride, int first, __global const uchar *codes,         \
        __global const int *firsts, __global const int2 *members, int vectors, int corner,     \
        __global const float *terms, float x, float y
#define GIVEN heights, stride, first, codes, firsts, members, vectors, corner, terms, x, y

// Slopes of the vector `column` of `row`; 0 where no triangle is under a texel.
inline slopes_t slopes_at(SURFACE, int column, int row)
{
    int i = corner + row * vectors + column, end = firsts[i + 1], member = firsts[i];
    uchar16 code = vload16(i, codes);
    slopes_t rises = rises_of(heights + first + row * stride + column * WIDTH, stride, code);
    x += column * WIDTH;
    y -= row;
    slopes_t found = slopes_in(terms + members[member].x * TERMS, rises, x, y);
    for (member++; member < end; member++) {
        slopes_t other = slopes_in(terms + members[member].x * TERMS, rises, x, y);
        int16 lanes = lanes_of(members[member].y);
        found.x = select(found.x, other.x, lanes);
        found.y = select(found.y, other.y, lanes);
    }
    if (!all(code == (uchar16)ALL)) {
        float16 inside = COUNTS(INSIDE);
        found.x *= inside;
        found.y *= inside;
    }
    return found;
}

// Level 0: mean slope and its products, of texels outside 0. Work-items: vectors of a row, rows.
__kernel void finest(SURFACE, __global float *mean_x, __global float *mean_y, __global float *xx,
                     __global float *xy, __global float *yy)
{
    int i = get_global_id(1) * get_global_size(0) + get_global_id(0);
    slopes_t own = slopes_at(GIVEN, get_global_id(0), get_global_id(1));
    vstore16(own.x, i, mean_x);
    vstore16(own.y, i, mean_y);
    vstore16(own.x * own.x, i, xx);
    vstore16(own.x * own.y, i, xy);
    vstore16(own.y * own.y, i, yy);
}

inline float8 mean_of(float16 top, float16 bottom)
{
    return 0.25f * ((top.even + top.odd) + (bottom.even + bottom.odd));
}

// Level 1 of a strip, from its vector `to` on. Work-items: vectors of a row, pairs of rows.
__kernel void halved(SURFACE, int to, __global float *mean_x, __global float *mean_y,
                     __global float *xx, __global float *xy, __global float *yy)
{
    int i = to + get_global_id(1) * get_global_size(0) + get_global_id(0);
    slopes_t top = slopes_at(GIVEN, get_global_id(0), 2 * get_global_id(1));
    slopes_t bottom = slopes_at(GIVEN, get_global_id(0), 2 * get_global_id(1) + 1);
    vstore8(mean_of(top.x, bottom.x), i, mean_x);
    vstore8(mean_of(top.y, bottom.y), i, mean_y);
    vstore8(mean_of(top.x * top.x, bottom.x * bottom.x), i, xx);
    vstore8(mean_of(top.x * top.y, bottom.x * bottom.y), i, xy);
    vstore8(mean_of(top.y * top.y, bottom.y * bottom.y), i, yy);
}
