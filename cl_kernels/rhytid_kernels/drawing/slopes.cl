// Slopes of the relief on the surface, and their products: the moments that level 0 has (Olano and Baker
// 2010, "LEAN mapping", eq. 7 to 9). Levels 1 and 2 are means of 2 x 2 and of 4 x 4 texels.
//
// A slope is a length over a length, along T and B of the texel: T is MikkTSpace's tangent in the plane of
// the interpolated normal n, B = sign n x T. The triangle's own axes, dP/du and what is across it, are
// turned into that plane, as exports/textures/writers.py has it for normal maps. The angle between both is
// atan2(s, c) with c = (a.T) (n.n) - (a.n) (T.n) and s = sign |n| n.(a x T), where a is the unit dP/du: each
// product is a polynomial of the place in the triangle, because n and T are linear there. In most triangles
// the angle itself is close to a polynomial of fourth degree: tangents.cl tries it in 16 places, and cosine and
// sine are off by 2e-6 there at most. Elsewhere each texel is turned exactly.
#include "cells.clh"
#include "slope_terms.clh"
#include "vectors.clh"

#define INLINE inline __attribute__((always_inline))
#define COLUMNS ((float16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))

// Of a row of a cell: slopes along T and B, or rises over two texels, right and up, mesh units.
typedef struct {
    float16 x, y;
} slopes_t;

// The rows of a cell. Rows have names, for PoCL keeps arrays of a work-item in memory.
typedef struct {
    slopes_t a, b, c, d;
} cell_t;

INLINE float16 linear(__global const float *t, float16 x, float16 y)
{
    return fma(x, (float16)t[1], fma(y, (float16)t[2], (float16)t[0]));
}

INLINE float16 quadratic(__global const float *t, float16 x, float16 y)
{
    float16 once = fma(x, (float16)t[3], fma(y, (float16)t[4], (float16)t[1]));
    return fma(x, once, fma(y, fma(y, (float16)t[5], (float16)t[2]), (float16)t[0]));
}

// x, y: of texels, from FROM.
INLINE slopes_t turned_exactly(__global const float *t, float16 x, float16 y, slopes_t rises)
{
    float16 size = quadratic(t + N_ON_N, x, y);
    float16 less = linear(t + ALONG_N, x, y) * quadratic(t + T_ON_N, x, y);
    float16 c = fma(linear(t + ALONG_T, x, y), size, -less);
    float16 s = quadratic(t + TURNED, x, y) * sqrt(size);
    float16 norm = t[PER_ALONG] * rsqrt(fma(c, c, fma(s, s, (float16)1e-30f)));
    float16 across = fma(rises.y, (float16)t[ACROSS], rises.x * -t[LEAN]);
    return (slopes_t){norm * fma(c, rises.x, s * across), norm * fma(c, across, -s * rises.x)};
}

// By an angle within 0.2.
INLINE slopes_t turned(__global const float *t, float16 angle, slopes_t rises)
{
    float16 x = fma(rises.x, (float16)t[AXES], rises.y * t[AXES + 1]);
    float16 y = fma(rises.x, (float16)t[AXES + 2], rises.y * t[AXES + 3]);
    SMALL_TURN(float16, angle, c, s);
    return (slopes_t){fma(c, x, s * y), fma(c, y, -s * x)};
}

// The slopes of `texels` of a row, as bits, into those of others.
INLINE void put(slopes_t own, int texels, slopes_t *to)
{
    int16 lanes = lanes_of(texels);
    to->x = as_float16(as_int16(to->x) | (as_int16(own.x) & lanes));
    to->y = as_float16(as_int16(to->y) | (as_int16(own.y) & lanes));
}

#define TURN_ROWS                                                                              \
    float16 along = (x - t[CENTROID_X]) + COLUMNS;                                             \
    float4 up = (y - t[CENTROID_Y]) - (float4)(0, 1, 2, 3);                                    \
    POLYNOMIAL_OF(float4, t, up)
#define ROW(k, row) turned(t, POLYNOMIAL_AT(float16, along, .s##k), rises.row)

// Slopes of a cell that lies in a triangle whose turn is close to its polynomial. x, y: of the first texel, from
// FROM.
INLINE cell_t slopes_of(__global const float *t, cell_t rises, float x, float y)
{
    TURN_ROWS;
    return (cell_t){ROW(0, a), ROW(1, b), ROW(2, c), ROW(3, d)};
}

#define PUT(k, row, slopes)                                                                    \
    if (texels.s##k)                                                                           \
    put(slopes, texels.s##k, &to->row)
#define EXACT(k, row) turned_exactly(t, x + COLUMNS, (float16)(y - k), rises.row)

// Slopes of some texels of each row, as bits, into `to`.
INLINE void put_slopes(__global const float *t, uint4 texels, cell_t rises, float x, float y,
                       cell_t *to)
{
    if (t[FITS] == 0) {
        PUT(0, a, EXACT(0, a));
        PUT(1, b, EXACT(1, b));
        PUT(2, c, EXACT(2, c));
        PUT(3, d, EXACT(3, d));
    } else {
        TURN_ROWS;
        PUT(0, a, ROW(0, a));
        PUT(1, b, ROW(1, b));
        PUT(2, c, ROW(2, c));
        PUT(3, d, ROW(3, d));
    }
}

#define IF(bit, value) select((float16)0, value, convert_int16((code & (uchar)bit) != (uchar)0))
#define COUNTS(bit) IF(bit, (float16)1)

// Rises of a row at `p`, beside rows above and below: the difference of both neighbours, or twice that to the
// one that may be used.
INLINE slopes_t rises_at_border(__global const float *p, __global const float *up,
                                __global const float *down, uchar16 code)
{
    float16 here = vload16(0, p);
    float16 right = IF(RIGHT, vload16(0, p + 1) - here), left = IF(LEFT, here - vload16(0, p - 1));
    float16 above = IF(ABOVE, vload16(0, up) - here), below = IF(BELOW, here - vload16(0, down));
    return (slopes_t){(right + left) / fmax(0.5f * (COUNTS(RIGHT) + COUNTS(LEFT)), 0.5f),
                      (above + below) / fmax(0.5f * (COUNTS(ABOVE) + COUNTS(BELOW)), 0.5f)};
}

INLINE slopes_t rises_inside(__global const float *p, float16 up, float16 down)
{
    return (slopes_t){vload16(0, p + 1) - vload16(0, p - 1), up - down};
}

// What a kernel reads. heights: rows of `stride`, mesh units, the first texel of the first row is `first`; a
// texel before and behind each row may be read, and is used where it is a neighbour. before, after: buffers
// with the row above the first and that below the last of `rows`, from `above` and `below` on. codes, firsts,
// members: of some rows of a map, which has `cells` cells per row; the first of them is at `column`, `row`,
// and its first texel at `x`, `y`, in texels from the lower left of UDIM 1001. terms: of each triangle.
#define SURFACE                                                                                \
    __global const float *heights, int stride, int first, int rows,                            \
        __global const float *before, int above, __global const float *after, int below,       \
        __global const uchar *codes, __global const int *firsts, __global const int *members,  \
        int cells, int column, int row, __global const float *terms, float x, float y
#define GIVEN                                                                                  \
    heights, stride, first, rows, before, above, after, below, codes, firsts, members, cells,  \
        column, row, terms, x, y

// Slopes of a cell: `i` cells right and `j` down; 0 where no triangle is under a texel.
INLINE cell_t slopes_at(SURFACE, int i, int j)
{
    cell_t rises, found = {{0, 0}, {0, 0}, {0, 0}, {0, 0}};
    int cell = (row + j) * cells + column + i;
    int member = firsts[cell] >> 1, end = firsts[cell + 1] >> 1;
    if (member == end)
        return found;
    __global const float *pa = heights + first + HIGH * j * stride + i * WIDE;
    __global const float *pb = pa + stride, *pc = pb + stride, *pd = pc + stride;
    __global const float *up = j > 0 ? pa - stride : before + above + i * WIDE;
    __global const float *down = HIGH * (j + 1) < rows ? pd + stride : after + below + i * WIDE;
    if (firsts[cell] & 1) {
        int code = HIGH * (row + j) * cells + column + i;
        rises.a = rises_at_border(pa, up, pb, vload16(code, codes));
        rises.b = rises_at_border(pb, pa, pc, vload16(code + cells, codes));
        rises.c = rises_at_border(pc, pb, pd, vload16(code + 2 * cells, codes));
        rises.d = rises_at_border(pd, pc, down, vload16(code + 3 * cells, codes));
    } else {
        float16 a = vload16(0, pa), b = vload16(0, pb), c = vload16(0, pc), d = vload16(0, pd);
        rises.a = rises_inside(pa, vload16(0, up), b);
        rises.b = rises_inside(pb, a, c);
        rises.c = rises_inside(pc, b, d);
        rises.d = rises_inside(pd, c, vload16(0, down));
    }
    x += i * WIDE;
    y -= HIGH * j;
    for (; member < end; member++) {
        int3 of = vload3(member, members);
        __global const float *t = terms + of.x * TERMS;
        if ((of.y & of.z) == -1 && t[FITS] != 0)
            return slopes_of(t, rises, x - t[FROM_X], y - t[FROM_Y]);
        uint4 texels = (uint4)(of.y, (uint)of.y >> WIDE, of.z, (uint)of.z >> WIDE) & 0xffff;
        put_slopes(t, texels, rises, x - t[FROM_X], y - t[FROM_Y], &found);
    }
    return found;
}

// Level 0 of a row: mean slope and its products, of texels outside 0.
INLINE void keep(slopes_t own, int i, int texels, __global float *moments)
{
    vstore16(own.x, i, moments);
    vstore16(own.y, i, moments + texels);
    vstore16(own.x * own.x, i, moments + 2 * texels);
    vstore16(own.x * own.y, i, moments + 3 * texels);
    vstore16(own.y * own.y, i, moments + 4 * texels);
}

// Level 0. moments: five planes. Work-items: cells of a row, rows of cells.
__kernel void finest(SURFACE, __global float *moments)
{
    int i = get_global_id(0), j = get_global_id(1), width = get_global_size(0);
    int texels = CELL * get_global_size(1) * width, at = HIGH * j * width + i;
    cell_t own = slopes_at(GIVEN, i, j);
    keep(own.a, at, texels, moments);
    keep(own.b, at + width, texels, moments);
    keep(own.c, at + 2 * width, texels, moments);
    keep(own.d, at + 3 * width, texels, moments);
}

// Sums over two rows.
typedef struct {
    float16 x, y, xx, xy, yy;
} sums_t;

INLINE sums_t sums_of(slopes_t a, slopes_t b)
{
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

// Levels 1 and 2 of `cells` cells a row: five planes each, of a map of which these are the rows from `to`
// of level 2 on. keeps: whether level 1 is asked for. Work-items: cells of a row, rows of level 2.
__kernel void levels(SURFACE, int to, int keeps, __global float *first_level,
                     __global float *second_level)
{
    int i = get_global_id(0), j = get_global_id(1), at = to + j;
    size_t plane = (size_t)cells * cells * (WIDE / 4) * (WIDE / 4);
    cell_t own = slopes_at(GIVEN, i, j);
    sums_t a = sums_of(own.a, own.b), b = sums_of(own.c, own.d);
    if (keeps) {
        keep_pairs(a, 2 * at * cells + i, 4 * plane, first_level);
        keep_pairs(b, (2 * at + 1) * cells + i, 4 * plane, first_level);
    }
    at = at * cells + i;
    vstore4(fours(a.x, b.x), at, second_level);
    vstore4(fours(a.y, b.y), at, second_level + plane);
    vstore4(fours(a.xx, b.xx), at, second_level + 2 * plane);
    vstore4(fours(a.xy, b.xy), at, second_level + 3 * plane);
    vstore4(fours(a.yy, b.yy), at, second_level + 4 * plane);
}
