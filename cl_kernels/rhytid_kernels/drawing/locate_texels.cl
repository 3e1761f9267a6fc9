// Finds the triangles of the texels of a tile: of HIGH rows of sixteen at once, which have nearly all
// candidates in common.
#define REAL float16
#define MASK int16
#define ANY(mask) any(mask)
#include "locate.clh"

#define LANES 16
#define HIGH 8

// The texels of a work-item: their places, of those in rows the lanes; their cells, inclusive; and what is
// known of each row: the triangle, `none` until there is one.
typedef struct {
    float16 x;
    float y[HIGH];
    int left, right, low, high;
    int16 found[HIGH];
} texels_t;

// A side of a triangle as side_of has it, so that what all rows have in common is found once: the same bits.
typedef struct {
    float along, low;
    float16 across;
} side_t;

inline side_t side_from(float2 a, float2 b, float16 x)
{
    bool swap = out_of_order(a, b);
    float2 low = swap ? b : a, high = swap ? a : b, e = high - low;
    float16 across = e.y * (x - low.x);
    side_t side = {swap ? -e.x : e.x, low.y, swap ? -across : across};
    return side;
}

inline float16 side_at(side_t side, float y)
{
    return side.along * (float16)(y - side.low) - side.across;
}

// Triangle i, where it holds a texel and no lower one does.
inline void take_if_held(texels_t *t, uv_triangle triangle, int i)
{
    const side_t ab = side_from(triangle.a, triangle.b, t->x);
    const side_t bc = side_from(triangle.b, triangle.c, t->x);
    const side_t ca = side_from(triangle.c, triangle.a, t->x);
    for (int row = 0; row < HIGH; row++) {
        const float16 s0 = side_at(ab, t->y[row]), s1 = side_at(bc, t->y[row]), s2 = side_at(ca, t->y[row]);
        const float16 least = min(s0, min(s1, s2)), most = max(s0, max(s1, s2));
        const int16 held = (least >= 0.0f) | (most <= 0.0f), found = t->found[row];
        t->found[row] = select(found, min(found, i), held);
    }
}

// Of texels that no triangle holds the nearest one.
inline int16 nearest_in(const texels_t *t, int row, __global const float *corners,
                        __global const int *offsets, __global const int *members, int cells,
                        float reach2, int none)
{
    int16 nearest = none;
    float16 best = reach2;
    for (int y = t->low; y <= t->high; y++)
        for (int k = offsets[y * cells + t->left]; k < offsets[y * cells + t->right + 1]; k++)
            take_if_nearer(&nearest, &best, load_triangle(corners, members[k]), members[k], t->x,
                           (float16)(t->y[row]));
    return nearest;
}

// From texel (row, column) of a level of `side` texels on.
inline texels_t texels_from(int row, int column, int side, int cells, int none)
{
    const float16 centres = {0.5f, 1.5f, 2.5f,  3.5f,  4.5f,  5.5f,  6.5f,  7.5f,
                             8.5f, 9.5f, 10.5f, 11.5f, 12.5f, 13.5f, 14.5f, 15.5f};
    texels_t t;
    t.x = ((float)column + centres) / (float)side;
    for (int k = 0; k < HIGH; k++) {
        t.y[k] = (side - (row + k) - 0.5f) / (float)side;
        t.found[k] = none;
    }
    t.left = cell_of(t.x.s0, cells);
    t.right = cell_of(t.x.sF, cells);
    t.low = cell_of(t.y[HIGH - 1], cells);
    t.high = cell_of(t.y[0], cells);
    return t;
}

inline void store_row(int16 in, int lanes, __global int *found)
{
    if (lanes >= LANES)
        vstore16(in, 0, found);
    else
        for (int lane = 0; lane < lanes; lane++)
            found[lane] = ((const int *)&in)[lane];
}

// Work-item (i, j): texels 16 i to 16 i + 15 of rows HIGH j to HIGH j + HIGH - 1 of a rectangle of `count`
// rows of as many texels, of a level of `side` texels; row 0 is the top. offsets: of the members of each
// cell, and their end.
__kernel void locate_texels(__global const float *corners, __global const int *offsets,
                            __global const int *members, int cells, float reach2, int none,
                            int side, int row, int column, int count, __global int *found)
{
    const int first = get_global_id(0) * LANES, top = get_global_id(1) * HIGH;
    texels_t t = texels_from(row + top, column + first, side, cells, none);
    for (int y = t.low; y <= t.high; y++)
        for (int k = offsets[y * cells + t.left]; k < offsets[y * cells + t.right + 1]; k++)
            take_if_held(&t, load_triangle(corners, members[k]), members[k]);
    for (int k = 0; k < min(HIGH, count - top); k++) {
        int16 in = t.found[k];
        if (any(in == none))
            in = select(in, nearest_in(&t, k, corners, offsets, members, cells, reach2, none), in == none);
        store_row(in, count - first, found + (top + k) * count + first);
    }
}
