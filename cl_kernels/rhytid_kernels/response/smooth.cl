// Smooth sampling: per frame the fields of the UV vertices, then the response of every wrinkle and
// pore at its own point (Alg. 1 and 2). A UV vertex is a vertex of the mesh at one place in UV; its
// fields are means over its triangles by their share of the area around it, in a fixed order.
// fields: (G uu, uv, vv, H uu, uv, vv, 0, 0). For models without axes G is the identity and
// H = diag(log rho_u, log rho_v), whose axes are (1, 0) and (0, 1).
#include "clamped_log.clh"
#include "response.clh"
#include "smooth.clh"
#include "surface.clh"

inline float8 field_of(float3 metric, float3 log_stretch)
{
    return (float8)(metric, log_stretch, 0.0f, 0.0f);
}

inline float3 square(float2 v) // v v^T
{
    return (float3)(v.x * v.x, v.x * v.y, v.y * v.y);
}

// jacobian: rows of J in an orthonormal frame of the neutral triangle. axis: of log rho_1, in UV.
// The second term is left out: q2 q2^T = 1 - q1 q1^T keeps an even stretch exactly log rho G.
inline float3 log_form(float4 jacobian, float3 metric, float2 axis, float2 logs)
{
    float2 q = normalize((float2)(dot(jacobian.xy, axis), dot(jacobian.zw, axis)));
    return logs.y * metric + (logs.x - logs.y) * square(q.x * jacobian.xy + q.y * jacobian.zw);
}

// One work-item a UV vertex; members: its triangles, listed by offsets, and their shares.
// Without triangles of use it is unstretched.
__kernel void tensor_fields(__global const int *offsets, __global const int *members,
                            __global const float *shares, __global const float4 *jacobians,
                            __global const float4 *axes, __global const float2 *logs,
                            __global float8 *fields)
{
    int w = get_global_id(0);
    float3 metric = (float3)(0.0f), log_stretch = (float3)(0.0f);
    for (int k = offsets[w]; k < offsets[w + 1]; k++) {
        int t = members[k];
        float4 j = jacobians[t];
        float3 own = square(j.xy) + square(j.zw);
        metric += shares[k] * own;
        log_stretch += shares[k] * log_form(j, own, axes[t].xy, logs[t]);
    }
    bool any = offsets[w] < offsets[w + 1];
    fields[w] = field_of(any ? metric : (float3)(1.0f, 0.0f, 1.0f), log_stretch);
}

__kernel void uv_fields(__global const int *offsets, __global const int *members,
                        __global const float *shares, __global const float2 *logs,
                        __global float8 *fields)
{
    int w = get_global_id(0);
    float2 r = (float2)(0.0f);
    for (int k = offsets[w]; k < offsets[w + 1]; k++)
        r += shares[k] * logs[members[k]];
    fields[w] = field_of((float3)(1.0f, 0.0f, 1.0f), (float3)(r.x, 0.0f, r.y));
}

// vertex: of the mesh, for each UV vertex. tension: of each vertex of the mesh.
__kernel void tension_fields(__global const int *vertex, __global const float *tension, float limit,
                             __global float8 *fields)
{
    int w = get_global_id(0);
    float r = limited_log(tension[vertex[w]], limit);
    fields[w] = field_of((float3)(1.0f, 0.0f, 1.0f), (float3)(r, 0.0f, r));
}

// As respond.cl, with the stretch at the wrinkle's middle in the triangle that it samples.
// texels: a side of level 0, the unit of segments. neutral: fields of the neutral for angles on the
// surface, NULL for angles in UV. stiffness: of each wrinkle, or NULL. found: see RESPONSE.
__kernel void respond_smooth_wrinkles(__global const float4 *segments, __global const int *triangle,
                                      float texels, __global const float *corners,
                                      __global const int *vertices, __global const float8 *fields,
                                      int none, float limit, __global const float8 *neutral,
                                      __global const float *stiffness, float width_exponent,
                                      float depth_exponent, __global RESPONSE *found)
{
    int i = get_global_id(0);
    float4 s = segments[i];
    float2 middle = (s.xy + 0.5f * s.zw) / texels;
    principal_t p = principal(
        field_at(triangle[i], 1, middle.x, middle.y, corners, vertices, fields, none), limit);
    float2 theta = normalize(s.zw);
    float r = across(theta, p);
    if (neutral) {
        field_t at = field_at(triangle[i], 1, middle.x, middle.y, corners, vertices, neutral, none);
        r = across_surface(theta, p, at.metric);
    }
    r = stiffened(r, stiffness, i);
#if BENT
    found[i] = r;
#else
    scales_t scales = scales_of(r, width_exponent, depth_exponent, SCALE_LIMIT);
    found[i] = (float2)(scales.width, scales.depth);
#endif
}

// One work-item per pore; centres in texels. depth_limit: of sigma_d.
__kernel void respond_smooth_pores(__global const float2 *centres, __global const int *triangle,
                                   float texels, __global const float *corners,
                                   __global const int *vertices, __global const float8 *fields,
                                   int none, float limit, __global const float *stiffness,
                                   float width_exponent, float depth_exponent,
                                   float depth_limit, __global float2 *scales)
{
    int i = get_global_id(0);
    float2 centre = centres[i] / texels;
    principal_t p = principal(
        field_at(triangle[i], 1, centre.x, centre.y, corners, vertices, fields, none), limit);
    float r = mean_log_stretch((float2)(p.log1, p.log2));
    r = stiffened(r, stiffness, i);
    scales_t found = scales_of(r, width_exponent, depth_exponent, depth_limit);
    scales[i] = (float2)(found.width, found.depth);
}
