// Per-triangle stretch of a frame (section 2.2): one work-item per triangle, and one more that
// writes the neutral stretch for points that lie in no triangle.
#include "clamped_log.clh"
#include "stretch.clh"

// positions: 3 floats per vertex. faces: 3 indices per triangle.
// ratios, axes: unclamped rho and axes; logs: log rho within +-limit, dimensionless.
__kernel void stretch_tensor(__global const float *positions, __global const int *faces,
                             __global const float8 *rest, __global const float4 *frame_to_uv,
                             int triangles, float limit, __global float2 *ratios,
                             __global float4 *axes, __global float2 *logs)
{
    int i = get_global_id(0);
    stretch_t s = {(float2)(1.0f), (float2)(1.0f, 0.0f), (float2)(0.0f, 1.0f)};
    if (i < triangles)
        s = triangle_stretch(vload3(faces[3 * i], positions), vload3(faces[3 * i + 1], positions),
                             vload3(faces[3 * i + 2], positions), rest[i], frame_to_uv[i]);
    ratios[i] = s.ratio;
    axes[i] = (float4)(s.axis1, s.axis2);
    logs[i] = (float2)(limited_log(s.ratio.x, limit), limited_log(s.ratio.y, limit));
}
