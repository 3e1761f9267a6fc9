// As convolve.cl with smooth sampling: every texel has a kernel of its own. One work-item a texel.
#define HEIGHTS float
#define LOAD(at) (*(at))
#include "convolve.clh"
#include "smooth.clh"

// Below this difference of log rho, a few times its rounding, axes are that rounding's.
#define EVEN 1e-5f

// Axes that turn from texel to texel only where the stretch does. The models without axes of their
// own keep u first, then v, whichever is stretched more. So does, up to a conjugate direction, a
// stretch that is the same in all directions.
inline principal_t in_order(field_t f, int own_axes, float limit)
{
    principal_t p = principal(f, limit);
    if (own_axes && p.log1 - p.log2 > EVEN)
        return p;
    if (!own_axes) {
        p.log1 = clamp(f.log_stretch.uu / f.metric.uu, -limit, limit);
        p.log2 = clamp(f.log_stretch.vv / f.metric.vv, -limit, limit);
    }
    float over_length = rsqrt(f.metric.uv * f.metric.uv + f.metric.uu * f.metric.uu);
    p.u1 = 1.0f;
    p.v1 = 0.0f;
    p.u2 = -f.metric.uv * over_length;
    p.v2 = f.metric.uu * over_length;
    return p;
}

// metric: G = J^T J, so that |J s|^2 = s^T G s, within 2^-22 of its trace. reach: sigma times texels
// a side, in the unit of sqrt(G).
inline kernel_t kernel_in(form_t metric, float2 axis, float r, float2 gains, float reach,
                          float largest)
{
    float speed2 = axis.x * axis.x * metric.uu + 2.0f * axis.x * axis.y * metric.uv +
                   axis.y * axis.y * metric.vv;
    speed2 = fmax(speed2, LEAST_DETERMINANT * (metric.uu + metric.vv));
    float sigma = fmin(reach * rsqrt(speed2), largest);
    return (kernel_t)(axis.x, -axis.y, share_of(r, gains.x, gains.y), sigma);
}

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
