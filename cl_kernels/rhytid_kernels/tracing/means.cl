// A map less its mean around each texel, by weights that are the same along rows and columns. A tile is padded
// by `radius` texels or more. A vector of texels per work-item.
#include "vectors.clh"

// Means of rows. values: `width` texels a row.  taps: from -radius to radius.  apron: texels around the
// tile.  means: `side` columns, a multiple of WIDTH, and as many rows as values. Relative error of both
// kernels below 1e-5 of the mean of magnitudes.
__kernel void means_of_rows(int first, int count, __global const float *values, int width, int side, int apron,
                            int radius, __global const float *taps, __global float *means)
{
    int i = first + get_global_id(0), across = side / WIDTH;
    if (i >= count)
        return;
    __global const float *at = values + i / across * width + i % across * WIDTH + apron - radius;
    float16 sum = (float16)(0.0f);
    for (int k = 0; k <= 2 * radius; k++)
        sum += vload16(0, at + k) * taps[k];
    vstore16(sum, i, means);
}

// means: of means_of_rows.  out: factor times what values are above the means of squares, `side` columns.
__kernel void above_mean(int first, int count, __global const float *values, int width, int side, int apron,
                         int radius, __global const float *taps, __global const float *means, float factor,
                         __global float *out)
{
    int i = first + get_global_id(0), across = side / WIDTH;
    if (i >= count)
        return;
    int row = i / across + apron, column = i % across * WIDTH;
    __global const float *at = means + (row - radius) * side + column;
    float16 sum = (float16)(0.0f);
    for (int k = 0; k <= 2 * radius; k++)
        sum += vload16(0, at + k * side) * taps[k];
    vstore16(factor * (vload16(0, values + row * width + column + apron) - sum), i, out);
}
