// Adds events, single features of the skin, to a square that is drawn. Coordinates are texels from
// the lower left corner of a block, v up, so that any tiling gives the same bits. Within 1e-6 of the
// height of an event of weight 1 of the same in double.
#include "least_pore.clh"

#define LANES 8 // texels of a row at once; a block has a whole number of them
#define CENTRES (float8)(0.5f, 1.5f, 2.5f, 3.5f, 4.5f, 5.5f, 6.5f, 7.5f)

// Profile (1 - s)²(1 - rim t²): with s = t² a dome, or a pit that above rim 1 has a wall around it; with
// s = t⁴, where plateau is 1, flat with a soft rim. t2: t², at most 1. form: (plateau, rim).
inline float8 event_profile(float8 t2, float2 form)
{
    float8 inside = 1.0f - (form.x > 0.0f ? t2 * t2 : t2);
    return inside * inside * (1.0f - form.y * t2);
}

// The first texel of the first vector of a row of a block that an event reaches, and the last texel that
// it reaches. v: of the row, from its centre. x: of its centre.
inline int2 reached(float4 event, float x, float v)
{
    float gy = v * event.z, half_width = sqrt(max(1.0f - gy * gy, 0.0f)) / event.x;
    float middle = x - v * event.y / event.x;
    float low = clamp(middle - half_width, 0.0f, BLOCK + 1.0f);
    float high = clamp(middle + half_width, -1.0f, BLOCK - 1.0f);
    return (int2)((int)low / LANES * LANES, (int)floor(high));
}

// Adds what an event has in row y of a block, counted from the top: 0 beyond its rim. row: the texels of
// that row.
inline void add_row(float4 event, float2 form, float2 centre, int y, float depth, __global float *row)
{
    float v = BLOCK - 1 - y + 0.5f - centre.y, gy = v * event.z;
    if (!(gy * gy < 1.0f))
        return;
    int2 texels = reached(event, centre.x, v);
    for (int x = texels.x; x <= texels.y; x += LANES) {
        float8 gx = (x + CENTRES - centre.x) * event.x + v * event.y;
        float8 t2 = min(gx * gx + gy * gy, (float8)(1.0f));
        vstore8(vload8(0, row + x) + depth * (event.w * event_profile(t2, form)), 0, row + x);
    }
}

// centres: in texels of the UDIM, v up. roots: (xx, xy, yy, height in depths, below 0 for pits), the rim
// is where |root d| = 1. forms: of event_profile. scales: (sigma_w, sigma_d). offsets, members: the
// events of each block, ascending; blocks count from the top left, `blocks` in a row of the map. row,
// column: the first block. out: side² of displacement. A work-item draws STRIP rows of a block.
__kernel void add_events(__global const float2 *centres, __global const float4 *roots,
                         __global const float2 *forms, __global const float2 *scales,
                         __global const int *offsets, __global const int *members, float least,
                         float depth, int blocks, int row, int column, int side,
                         __global float *out)
{
    int across = column + get_global_id(0), top = STRIP * get_global_id(1), down = row + top / BLOCK;
    int block = down * blocks + across, first = offsets[block], end = offsets[block + 1];
    float2 corner = (float2)(across, blocks - 1 - down) * (float)BLOCK;
    out += top * side + get_global_id(0) * BLOCK;
    for (int k = first; k < end; k++) {
        int i = members[k];
        float4 event = scaled_pore(roots[i], scales[i], least);
        for (int y = 0; y < STRIP; y++)
            add_row(event, forms[i], centres[i] - corner, top % BLOCK + y, depth, out + y * side);
    }
}
