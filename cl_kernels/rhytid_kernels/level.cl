// One step up the pyramid: the mean of 2 x 2 texels, added in a fixed order.

__kernel void halve(__global const float *fine, __global float *coarse)
{
    int x = get_global_id(0), y = get_global_id(1), side = get_global_size(0);
    __global const float *top = fine + 4 * y * side + 2 * x, *bottom = top + 2 * side;
    coarse[y * side + x] = 0.25f * ((top[0] + top[1]) + (bottom[0] + bottom[1]));
}
