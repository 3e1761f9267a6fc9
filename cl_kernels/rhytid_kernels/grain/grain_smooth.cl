// As add_grain in grain.cl with smooth sampling: every texel has a stretch of its own.
#define REAL float16
#define MASK int16
#define ANY(mask) any(mask)
#include "grain.clh"
#include "texel_fields.clh"

POWER_OF_TWO(power16, float16, int16)

// side: of the level, whose texel (row, column) is the first of the tile. corners to limit: as in
// blend_smooth.cl. The rest: as in grain.cl.
__kernel void add_smooth_grain(__global const int *firsts, __global const int2 *members,
                               __global const char *codes, __global const float *stiffness,
                               __global const float *corners, __global const int *vertices,
                               __global const float8 *fields, int none, float limit, int side,
                               int row, int column, float exponent, float amplitude, float depth,
                               int width, int first, int out_width, int out_first,
                               __global float *out)
{
    int at = first + get_global_id(1) * width + get_global_id(0) * WIDTH, i = at / WIDTH;
    __global const int2 *member = members + firsts[i], *end = members + firsts[i + 1];
    float16 x = (columns(i, width) + (column + 0.5f)) / side;
    float16 y = (side - row - 0.5f - rows(i, width)) / side;
    principal_t p = principal(fields_at(member, end, x, y, corners, vertices, fields, none), limit);
    float16 stiff = stiffness ? vload16(0, stiffness + at) : (float16)(1.0f);
    float16 gain = GRAIN_GAIN(power16, stiff * p.log1, stiff * p.log2, exponent);
    out += out_first + get_global_id(1) * out_width + get_global_id(0) * WIDTH;
    float16 code = convert_float16(vload16(0, codes + at));
    vstore16(grained(vload16(0, out), code, gain, amplitude, depth), 0, out);
}
