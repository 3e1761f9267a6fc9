// Adds the residual of a scanned skin, what its wrinkle graph does not draw, to heights that are drawn.
// A vector of texels per work-item. Within 2^-22 of the largest height of the same in double.
#include "vectors.clh"

// codes: of a UDIM, `side` a row. step, middle: a texel is middle + step * code, mesh units. first: the
// first code of the square that is drawn. out: its heights, `width` a row, mesh units.
__kernel void add_residual(__global const short *codes, int side, int first, float step, float middle,
                           int width, __global float *out)
{
    int x = get_global_id(0) * WIDTH, y = get_global_id(1);
    out += y * width + x;
    float16 code = convert_float16(vload16(0, codes + first + y * side + x));
    vstore16(vload16(0, out) + fma(code, (float16)(step), (float16)(middle)), 0, out);
}
