// As convolve.cl with smooth sampling: every texel has a kernel of its own. One work-item per texel.
#include "convolve_smooth.clh"

// A square of a map of side² texels, from (row, column) on; source, triangles, stiffness and axis as
// in convolve.cl. metrics: fields of the neutral, for G, which only the model `tensor` has in its own.
__kernel void convolve_smooth(__global const float *source, int source_apron,
                              __global const int *triangles, int triangle_apron,
                              __global const float *stiffness, int axis, int side, int row,
                              int column, float2 gains, float reach, float largest,
                              __global const float8 *metrics, int own_axes,
                              __global const float *corners, __global const int *vertices,
                              __global const float8 *fields, int none, float limit,
                              __global float *out)
{
    int x = get_global_id(0), y = get_global_id(1), width = get_global_size(0);
    int2 inside = clamp((int2)(column + x, row + y), 0, side - 1);
    int2 at = inside - (int2)(column, row);
    int stride = width + 2 * source_apron, triangle_stride = width + 2 * triangle_apron;
    source += (at.y + source_apron) * stride + at.x + source_apron;
    int here = (at.y + triangle_apron) * triangle_stride + at.x + triangle_apron;
    int t = triangles[here];
    float u = (inside.x + 0.5f) / side, v = (side - inside.y - 0.5f) / side;
    principal_t p =
        in_order(field_at(t, 1, u, v, corners, vertices, fields, none), own_axes, limit);
    form_t metric = field_at(t, 1, u, v, corners, vertices, metrics, none).metric;
    float2 along = axis == 0 ? (float2)(p.u1, p.v1) : (float2)(p.u2, p.v2);
    float r = (axis == 0 ? p.log1 : p.log2) * (stiffness ? stiffness[here] : 1.0f);
    kernel_t k = kernel_in(metric, along, r, gains, reach, largest);
    out[y * width + x] = convolved(source, stride, k);
}
