// Adds the residual of a scanned skin, what its wrinkle graph does not draw, to heights that are drawn.
// A vector of texels per work-item. Within 2^-22 of the largest height of the same in double.
#include "vectors.clh"

inline void add_to(__global const short *codes, int side, int first, float step, float middle, int width,
                   __global float *out)
{
    int x = get_global_id(0) * WIDTH, y = get_global_id(1);
    out += y * width + x;
    float16 code = convert_float16(vload16(0, codes + first + y * side + x));
    vstore16(vload16(0, out) + fma(code, (float16)(step), (float16)(middle)), 0, out);
}

// codes: of a UDIM, `side` a row. step, middle: a texel is middle + step * code, mesh units. firsts: the
// first codes of up to four squares that are drawn, of which as many are looked at as there are items of
// the third dimension. out: their heights, `width` a row, mesh units.
__kernel void add_residual(__global const short *codes, int side, int4 firsts, float step, float middle,
                           int width, __global float *out0, __global float *out1, __global float *out2,
                           __global float *out3)
{
    switch (get_global_id(2)) {
    case 0:
        add_to(codes, side, firsts.x, step, middle, width, out0);
        break;
    case 1:
        add_to(codes, side, firsts.y, step, middle, width, out1);
        break;
    case 2:
        add_to(codes, side, firsts.z, step, middle, width, out2);
        break;
    case 3:
        add_to(codes, side, firsts.w, step, middle, width, out3);
        break;
    }
}
