// Slopes of the relief on the surface, and their products: the moments that level 0 has (Olano and Baker
// 2010, "LEAN mapping", eq. 7 to 9). Levels 1 and 2 are means of 2 x 2 and of 4 x 4 texels.
//
// A slope is a length over a length, along T and B of the texel: T is MikkTSpace's tangent in the plane of
// the interpolated normal n, B = sign n x T. The triangle's own axes, dP/du and what is across it, are
// turned into that plane, as exports/textures/writers.py has it for normal maps. The angle between both is
// atan2(s, c) with c = (a.T) (n.n) - (a.n) (T.n) and s = sign |n| n.(a x T), where a is the unit dP/du: each
// product is a polynomial of the place in the triangle, because n and T are linear there.
#include "cells.clh"
#include "slope_terms.clh"

#define INLINE inline __attribute__((always_inline))

typedef struct {
    float16 x, y;
} slopes_t;

// The two rows of a cell.
typedef struct {
    slopes_t top, bottom;
} cell_t;

// Cosine and sine of the angle from the axes of a triangle to those of the texel, over two texels along.
typedef struct {
    float8 c, s;
} turn_t;

INLINE float8 linear(__global const float *t, float8 x, float8 y)
{
    return fma(x, (float8)t[1], fma(y, (float8)t[2], (float8)t[0]));
}

INLINE float8 quadratic(__global const float *t, float8 x, float8 y)
{
    float8 once = fma(x, (float8)t[3], fma(y, (float8)t[4], (float8)t[1]));
    return fma(x, once, fma(y, fma(y, (float8)t[5], (float8)t[2]), (float8)t[0]));
}

INLINE turn_t turn_at(__global const float *t, float8 x, float8 y)
{
    float8 size = quadratic(t + N_ON_N, x, y);
    float8 less = linear(t + ALONG_N, x, y) * quadratic(t + T_ON_N, x, y);
    float8 c = fma(linear(t + ALONG_T, x, y), size, -less);
    float8 s = quadratic(t + TURNED, x, y) * sqrt(size);
    float8 norm = t[PER_ALONG] * rsqrt(fma(c, c, fma(s, s, (float8)1e-30f)));
    return (turn_t){c * norm, s * norm};
}

// The cubic of 16 texels that is `at` in texels 0, 5, 10 and 15.
INLINE float16 between(float4 at)
{
    const float16 x = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    const float16 a = (x - 5) * (x - 10) * (x - 15) / -750.0f, b = x * (x - 10) * (x - 15) / 250.0f;
    const float16 c = x * (x - 5) * (x - 15) / -250.0f, d = x * (x - 5) * (x - 10) / 750.0f;
    return fma((float16)at.x, a, fma((float16)at.y, b, fma((float16)at.z, c, at.w * d)));
}

INLINE slopes_t turned(float16 c, float16 s, __global const float *t, slopes_t rises)
{
    float16 across = fma(rises.y, (float16)t[ACROSS], rises.x * -t[LEAN]);
    return (slopes_t){fma(c, rises.x, s * across), fma(c, across, -s * rises.x)};
}

// As if every texel lay in one triangle. rises: of the heights over two texels, right and up, mesh units.
// x, y: of the first texel, in texels from the lower left of UDIM 1001. Where the angle bends little over a
// cell, it is a cubic through four texels of each row: off by 1.1e-5 of a slope at most in a million random
// triangles that bend as much as SMOOTH allows.
INLINE cell_t cell_in(__global const float *t, cell_t rises, float x, float y)
{
    x -= t[FROM_X];
    y -= t[FROM_Y];
    if (t[SMOOTH] != 0) {
        turn_t at = turn_at(t, x + (float8)(0, 5, 10, 15, 0, 5, 10, 15),
                            y - (float8)(0, 0, 0, 0, 1, 1, 1, 1));
        return (cell_t){turned(between(at.c.lo), between(at.s.lo), t, rises.top),
                        turned(between(at.c.hi), between(at.s.hi), t, rises.bottom)};
    }
    float8 near = x + (float8)(0, 1, 2, 3, 4, 5, 6, 7), far = near + 8;
    turn_t a = turn_at(t, near, y), b = turn_at(t, far, y);
    turn_t c = turn_at(t, near, y - 1), d = turn_at(t, far, y - 1);
    return (cell_t){turned((float16)(a.c, b.c), (float16)(a.s, b.s), t, rises.top),
                    turned((float16)(c.c, d.c), (float16)(c.s, d.s), t, rises.bottom)};
}

#define IF(bit, value) select((float16)0, value, convert_int16((code & (uchar)bit) != (uchar)0))
#define COUNTS(bit) IF(bit, (float16)1)

// Rises over two texels, right and up, of a vector at `p`, beside rows above and below: the difference of both
// neighbours, or twice that to the one that may be used.
INLINE slopes_t rises_at_border(__global const float *p, __global const float *up,
                                __global const float *down, uchar16 code)
{
    float16 here = vload16(0, p);
    float16 right = IF(RIGHT, vload16(0, p + 1) - here), left = IF(LEFT, here - vload16(0, p - 1));
    float16 above = IF(ABOVE, vload16(0, up) - here), below = IF(BELOW, here - vload16(0, down));
    return (slopes_t){(right + left) / fmax(0.5f * (COUNTS(RIGHT) + COUNTS(LEFT)), 0.5f),
                      (above + below) / fmax(0.5f * (COUNTS(ABOVE) + COUNTS(BELOW)), 0.5f)};
}

INLINE slopes_t rises_inside(__global const float *p, __global const float *up,
                             __global const float *down)
{
    return (slopes_t){vload16(0, p + 1) - vload16(0, p - 1), vload16(0, up) - vload16(0, down)};
}

// What a kernel reads. heights: rows of `stride`, mesh units, the first texel of the first row is `first`; a
// texel before and behind each row may be read, and is used where it is a neighbour. before, after: buffers
// with the row above the first and that below the last of `rows`, from `above` and `below` on. codes, firsts,
// members: of some rows of a map, which has `vectors` cells per row; the first of them is at `column`, `row`,
// and its first texel at `x`, `y`. terms: of each triangle.
#define SURFACE                                                                                \
    __global const float *heights, int stride, int first, int rows,                            \
        __global const float *before, int above, __global const float *after, int below,       \
        __global const uchar *codes, __global const int *firsts, __global const int2 *members, \
        int vectors, int column, int row, __global const float *terms, float x, float y
#define GIVEN                                                                                  \
    heights, stride, first, rows, before, above, after, below, codes, firsts, members, vectors, \
        column, row, terms, x, y

// Slopes of a cell: `i` cells right and `j` pairs of rows down; 0 where no triangle is under a texel.
INLINE cell_t slopes_at(SURFACE, int i, int j)
{
    const cell_t none = {{0, 0}, {0, 0}};
    int cell = (row + j) * vectors + column + i;
    int member = firsts[cell] >> 1, end = firsts[cell + 1] >> 1;
    if (member == end)
        return none;
    __global const float *top = heights + first + 2 * j * stride + i * WIDTH;
    __global const float *bottom = top + stride;
    __global const float *up = j > 0 ? top - stride : before + above + i * WIDTH;
    __global const float *down = 2 * j + 2 < rows ? bottom + stride : after + below + i * WIDTH;
    cell_t rises;
    if (firsts[cell] & 1) {
        int code = (row + j) * 2 * vectors + column + i;
        rises.top = rises_at_border(top, up, bottom, vload16(code, codes));
        rises.bottom = rises_at_border(bottom, top, down, vload16(code + vectors, codes));
    } else {
        rises.top = rises_inside(top, up, bottom);
        rises.bottom = rises_inside(bottom, top, down);
    }
    x += i * WIDTH;
    y -= 2 * j;
    cell_t found = none;
    for (; member < end; member++) {
        int2 of = members[member];
        cell_t here = cell_in(terms + of.x * TERMS, rises, x, y);
        if (of.y == -1)
            return here;
        int16 lanes = lanes_of(of.y), lower = lanes_of(of.y >> WIDTH);
        found.top.x = as_float16(as_int16(found.top.x) | (as_int16(here.top.x) & lanes));
        found.top.y = as_float16(as_int16(found.top.y) | (as_int16(here.top.y) & lanes));
        found.bottom.x = as_float16(as_int16(found.bottom.x) | (as_int16(here.bottom.x) & lower));
        found.bottom.y = as_float16(as_int16(found.bottom.y) | (as_int16(here.bottom.y) & lower));
    }
    return found;
}

// Level 0 of a vector: mean slope and its products, of texels outside 0.
INLINE void keep(slopes_t own, int i, int texels, __global float *moments)
{
    vstore16(own.x, i, moments);
    vstore16(own.y, i, moments + texels);
    vstore16(own.x * own.x, i, moments + 2 * texels);
    vstore16(own.x * own.y, i, moments + 3 * texels);
    vstore16(own.y * own.y, i, moments + 4 * texels);
}

// Level 0. moments: five planes. Work-items: cells of a row, pairs of rows.
__kernel void finest(SURFACE, __global float *moments)
{
    int i = get_global_id(0), j = get_global_id(1), width = get_global_size(0);
    int texels = 2 * get_global_size(1) * width * WIDTH;
    cell_t own = slopes_at(GIVEN, i, j);
    keep(own.top, 2 * j * width + i, texels, moments);
    keep(own.bottom, (2 * j + 1) * width + i, texels, moments);
}

// Sums over the rows of a cell, or of two.
typedef struct {
    float16 x, y, xx, xy, yy;
} sums_t;

INLINE sums_t sums_of(cell_t own)
{
    slopes_t a = own.top, b = own.bottom;
    return (sums_t){a.x + b.x, a.y + b.y, fma(a.x, a.x, b.x * b.x), fma(a.x, a.y, b.x * b.y),
                    fma(a.y, a.y, b.y * b.y)};
}

INLINE float8 pairs(float16 sum)
{
    return sum.even + sum.odd;
}

INLINE float4 fours(float16 upper, float16 lower)
{
    float8 sum = pairs(upper + lower);
    return 0.0625f * (sum.even + sum.odd);
}

INLINE void keep_pairs(sums_t own, int i, size_t plane, __global float *moments)
{
    vstore8(0.25f * pairs(own.x), i, moments);
    vstore8(0.25f * pairs(own.y), i, moments + plane);
    vstore8(0.25f * pairs(own.xx), i, moments + 2 * plane);
    vstore8(0.25f * pairs(own.xy), i, moments + 3 * plane);
    vstore8(0.25f * pairs(own.yy), i, moments + 4 * plane);
}

// Levels 1 and 2 of `vectors` cells a row: five planes each, of a map of which these are the rows from `to`
// of level 2 on. keeps: whether level 1 is asked for. Work-items: cells of a row, rows of level 2.
__kernel void levels(SURFACE, int to, int keeps, __global float *first_level,
                     __global float *second_level)
{
    int i = get_global_id(0), j = get_global_id(1), at = to + j;
    size_t plane = (size_t)vectors * vectors * (WIDTH / 4) * (WIDTH / 4);
    sums_t a = sums_of(slopes_at(GIVEN, i, 2 * j)), b = sums_of(slopes_at(GIVEN, i, 2 * j + 1));
    if (keeps) {
        keep_pairs(a, 2 * at * vectors + i, 4 * plane, first_level);
        keep_pairs(b, (2 * at + 1) * vectors + i, 4 * plane, first_level);
    }
    at = at * vectors + i;
    vstore4(fours(a.x, b.x), at, second_level);
    vstore4(fours(a.y, b.y), at, second_level + plane);
    vstore4(fours(a.xx, b.xx), at, second_level + 2 * plane);
    vstore4(fours(a.xy, b.xy), at, second_level + 3 * plane);
    vstore4(fours(a.yy, b.yy), at, second_level + 4 * plane);
}
