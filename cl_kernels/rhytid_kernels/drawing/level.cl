// One step up the pyramid: the mean of 2 x 2 texels, added in a fixed order. The order is the same for
// every texel, so a level has the same bits however its squares were cut.

// fine: a square of twice as many texels per side as there are work-items. coarse: the square that its
// means are a part of, of `stride` texels per side; they go from texel `first` on.
__kernel void halve(__global const float *fine, int stride, int first, __global float *coarse)
{
    int x = get_global_id(0), y = get_global_id(1), side = get_global_size(0);
    __global const float *top = fine + 4 * y * side + 2 * x, *bottom = top + 2 * side;
    coarse[first + y * stride + x] = 0.25f * ((top[0] + top[1]) + (bottom[0] + bottom[1]));
}
