// Stretch along the UV axes (Zoss et al. 2020): rho_u = |J' e_u| / |J e_u|, rho_v likewise, with
// J = dX/d(u, v). J' e_u is a combination of the deformed edges whose weights are known beforehand.
#include "clamped_log.clh"
#include "triangle_edges.clh"

// |a first + b second|, a and b in high and low parts. Relative error below 1e-6.
inline float combined_length(edge_t first, edge_t second, twofloat a, twofloat b)
{
    edge_t sum;
    sum.x = tf_add(tf_mul(first.x, a), tf_mul(second.x, b));
    sum.y = tf_add(tf_mul(first.y, a), tf_mul(second.y, b));
    sum.z = tf_add(tf_mul(first.z, a), tf_mul(second.z, b));
    float3 e = (float3)(sum.x.x, sum.y.x, sum.z.x);
    float size = fmax(fabs(e.x), fmax(fabs(e.y), fabs(e.z)));
    return size > 0.0f ? size * length(e / size) : 0.0f;
}

// weights: (a, b) along u, then along v, each as a high and a low part, over |J e|; all zero for a
// triangle without usable area. ratios, axes, logs: as in stretch.cl.
__kernel void stretch_uv(__global const float *positions, __global const int *faces,
                         __global const float8 *weights, int triangles, float limit,
                         __global float2 *ratios, __global float4 *axes, __global float2 *logs)
{
    int i = get_global_id(0);
    float2 ratio = (float2)(1.0f);
    if (i < triangles && any(weights[i].s0246 != 0.0f)) {
        point_t p = point_at(faces[3 * i], positions), q = point_at(faces[3 * i + 1], positions),
                r = point_at(faces[3 * i + 2], positions);
        int exponent = edge_exponent(p, q, r);
        edge_t first = edge_between(p, q, exponent), second = edge_between(p, r, exponent);
        float8 w = weights[i];
        ratio.x = ldexp(combined_length(first, second, tf_of(w.s0, w.s1), tf_of(w.s2, w.s3)), -exponent);
        ratio.y = ldexp(combined_length(first, second, tf_of(w.s4, w.s5), tf_of(w.s6, w.s7)), -exponent);
    }
    ratios[i] = ratio;
    axes[i] = (float4)(1.0f, 0.0f, 0.0f, 1.0f);
    logs[i] = (float2)(limited_log(ratio.x, limit), limited_log(ratio.y, limit));
}
