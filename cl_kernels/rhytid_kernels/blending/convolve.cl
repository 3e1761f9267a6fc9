// The neutral map convolved along both axes of each texel's triangle (after Nagano et al. 2015).
// Rectangles carry an apron of texels, so that a tile is the crop of the whole map bit for bit.
#include "convolve.clh"
#include "vectors.clh"

// One work-item per triangle; kernels: along its two axes. gains: (blur, sharpen).
__kernel void triangle_kernels(__global const float4 *axes, __global const float2 *logs,
                               __global const float4 *jacobians, float2 gains, float reach,
                               float largest, __global kernel_t *kernels)
{
    int t = get_global_id(0);
    float4 axis = axes[t], jacobian = jacobians[t];
    float2 r = logs[t];
    kernels[2 * t] = kernel_along(axis.xy, r.x, jacobian, gains, reach, largest);
    kernels[2 * t + 1] = kernel_along(axis.zw, r.y, jacobian, gains, reach, largest);
}

// A square from texel (row, column) of a map of side² texels on, out of a part of part_side² texels
// from part_corner (column, row) on. Beyond the border of the map: the texel at the border.
__kernel void extend(__global const float *part, int2 part_corner, int part_side, int side, int row,
                     int column, __global float *out)
{
    int x = get_global_id(0), y = get_global_id(1);
    int2 from = clamp((int2)(column + x, row + y), 0, side - 1) - part_corner;
    out[y * get_global_size(0) + x] = part[from.y * part_side + from.x];
}

// Along one axis (0 or 1), sixteen texels of a row a work-item. Out goes a square of a map of side²
// texels, from (row, column) on, columns in steps of WIDTH; in come source, wider by source_apron on
// every side, and triangles, wider by triangle_apron. A vector is convolved once for each triangle in
// it, and each texel takes its own. stiffness: as wide as triangles, or NULL. Beyond the border of the
// map: the result at the border.
__kernel void convolve(__global const float *source, int source_apron,
                       __global const int *triangles, int triangle_apron,
                       __global const float *stiffness,
                       __global const kernel_t *kernels, int axis, int side, int row, int column,
                       __global float *out)
{
    int x = get_global_id(0) * WIDTH, y = get_global_id(1), width = get_global_size(0) * WIDTH;
    int2 inside = clamp((int2)(column + x, row + y), (int2)(0), (int2)(side - WIDTH, side - 1));
    int2 at = inside - (int2)(column, row);
    int stride = width + 2 * source_apron, triangle_stride = width + 2 * triangle_apron;
    source += (at.y + source_apron) * stride + at.x + source_apron;
    int first = (at.y + triangle_apron) * triangle_stride + at.x + triangle_apron;
    triangles += first;
    int16 t = vload16(0, triangles);
    float16 stiff = stiffness ? vload16(0, stiffness + first) : (float16)(1.0f);
    float16 found = 0.0f;
    for (int lane = 0; lane < WIDTH; lane++)
        if (lane == 0 || triangles[lane] != triangles[lane - 1]) {
            int here = triangles[lane];
            kernel_t k = kernels[2 * here + axis];
            float16 alpha = clamp(k.z * stiff, -1.0f, 1.0f);
            found = select(found, convolved_by(source, stride, k, alpha), t == here);
        }
    if (column + x < inside.x)
        found = (float16)(found.s0);
    if (column + x > inside.x)
        found = (float16)(found.sf);
    vstore16(found, 0, out + y * width + x);
}
