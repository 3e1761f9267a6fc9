// Per-triangle stretch of a frame (section 2.2): LANES triangles per work-item, and one more that has the
// neutral stretch for points that lie in no triangle. They are gathered one by one; what follows is
// vectors.
#define LANES 8
#define REAL float8
#define WHOLE int8
#define AS_REAL as_float8
#define AS_WHOLE as_int8
#include "clamped_log.clh"
#include "stretch.clh"

// Of LANES triangles, the last one in place of none.
inline gradient_t gradients_of(const int *numbers, int last, __global const float *positions,
                               __global const int *faces, __global const float8 *rest)
{
    float corner[9][LANES], of_rest[6][LANES];
    for (int lane = 0; lane < LANES; lane++) {
        int t = min(numbers[lane], last);
        for (int k = 0; k < 9; k++)
            corner[k][lane] = positions[3 * faces[3 * t + k / 3] + k % 3];
        for (int k = 0; k < 6; k++)
            of_rest[k][lane] = ((__global const float *)(rest + t))[k];
    }
    point_t at[3];
    for (int k = 0; k < 3; k++) {
        at[k].x = vload8(0, corner[3 * k]);
        at[k].y = vload8(0, corner[3 * k + 1]);
        at[k].z = vload8(0, corner[3 * k + 2]);
    }
    rest_t neutral = {tf_of(vload8(0, of_rest[0]), vload8(0, of_rest[1])),
                      tf_of(vload8(0, of_rest[2]), vload8(0, of_rest[3])),
                      tf_of(vload8(0, of_rest[4]), vload8(0, of_rest[5]))};
    return deformation_gradient(at[0], at[1], at[2], neutral);
}

inline float2 to_uv(float4 frame_to_uv, float2 v) // rows of the matrix in xy and zw
{
    return normalize((float2)(dot(frame_to_uv.xy, v), dot(frame_to_uv.zw, v)));
}

// wanted: the numbers of triangles, or NULL for all. positions: 3 floats per vertex. faces: 3 indices per
// triangle. rest: as rest_t, high and low parts; 0 where a triangle has no usable area in the neutral, and
// counts as unstretched. count: of all that is written, those behind `triangles` unstretched, too.
// ratios: the principal stretches rho1 >= rho2 >= 0, axes: unit vectors in UV, sign free, both
// unclamped; logs: log rho within +-limit, dimensionless.
__kernel void stretch_tensor(__global const int *wanted, __global const float *positions,
                             __global const int *faces, __global const float8 *rest,
                             __global const float4 *frame_to_uv, int triangles, int count,
                             float limit, __global float2 *ratios, __global float4 *axes,
                             __global float2 *logs)
{
    const int first = get_global_id(0) * LANES;
    int numbers[LANES];
    float rho1[LANES], rho2[LANES], x[LANES], y[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        int i = min(first + lane, count - 1);
        numbers[lane] = wanted ? wanted[i] : i;
    }
    if (triangles > 0) {
        gradient_t g = gradients_of(numbers, triangles - 1, positions, faces, rest);
        pair_t rho = singular_values(g), v = right_singular_vector(g);
        vstore8(rho.x, 0, rho1);
        vstore8(rho.y, 0, rho2);
        vstore8(v.x, 0, x);
        vstore8(v.y, 0, y);
    }
    for (int lane = 0; lane < min(LANES, count - first); lane++) {
        int i = numbers[lane];
        float2 ratio = (float2)(1.0f), axis1 = (float2)(1.0f, 0.0f), axis2 = (float2)(0.0f, 1.0f);
        if (i < triangles && rest[i].s0 != 0.0f) {
            ratio = (float2)(rho1[lane], rho2[lane]);
            axis1 = to_uv(frame_to_uv[i], (float2)(x[lane], y[lane]));
            axis2 = to_uv(frame_to_uv[i], (float2)(-y[lane], x[lane]));
        }
        ratios[i] = ratio;
        axes[i] = (float4)(axis1, axis2);
        logs[i] = (float2)(limited_log(ratio.x, limit), limited_log(ratio.y, limit));
    }
}
