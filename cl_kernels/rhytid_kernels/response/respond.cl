// Width and depth scales of every wrinkle and pore of a frame (Alg. 1 and 2). A work-item takes LANES
// of them: stretch is gathered one by one, what follows is vectors.
#include "groups.clh"
#include "response.clh"
#define LEAST_SQUARE 1e-30f // below that of any wrinkle: one of no length runs nowhere

POWER_OF_TWO(power16, float16, int16)

// (sigma_w, sigma_d) of elements `first` and following.
inline void store_scales(float16 r, float width_exponent, float depth_exponent, float depth_limit,
                         int first, int count, __global float2 *scales)
{
    float width[LANES], depth[LANES];
    vstore16(SCALE(power16, r, width_exponent, SCALE_LIMIT), 0, width);
    vstore16(SCALE(power16, r, -depth_exponent, depth_limit), 0, depth);
    for (int lane = 0; lane < min(LANES, count - first); lane++)
        scales[first + lane] = (float2)(width[lane], depth[lane]);
}

// groups: as in first_in_group. triangle: what the centre of each wrinkle samples. jacobians: NULL for
// angles in UV. stiffness: of each wrinkle, or NULL. found: see RESPONSE.
__kernel void respond_wrinkles(__global const int *groups, __global const float4 *segments,
                               __global const int *triangle, __global const float4 *axes,
                               __global const float2 *logs, __global const float4 *jacobians,
                               __global const float *stiffness, int count, float width_exponent,
                               float depth_exponent, __global RESPONSE *found)
{
    int first = first_in_group(groups);
    float square[LANES], along1[LANES], along2[LANES], first_log[LANES], second_log[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        int i = min(first + lane, count - 1), t = triangle[i];
        angles_t a = angles_in(t, segments[i].zw, axes, jacobians);
        square[lane] = dot(a.theta, a.theta) + LEAST_SQUARE;
        along1[lane] = dot(a.theta, a.axes.xy);
        along2[lane] = dot(a.theta, a.axes.zw);
        first_log[lane] = stiffened(logs[t].x, stiffness, i);
        second_log[lane] = stiffened(logs[t].y, stiffness, i);
    }
    float16 per_length = 1.0f / sqrt(vload16(0, square));
    float16 cosine1 = vload16(0, along1) * per_length, cosine2 = vload16(0, along2) * per_length;
    float16 r = ACROSS(cosine1, cosine2, vload16(0, first_log), vload16(0, second_log));
#if BENT
    float of_lane[LANES];
    vstore16(r, 0, of_lane);
    for (int lane = 0; lane < min(LANES, count - first); lane++)
        found[first + lane] = of_lane[lane];
#else
    store_scales(r, width_exponent, depth_exponent, SCALE_LIMIT, first, count, found);
#endif
}

// Of pores. depth_limit: of sigma_d.
__kernel void respond_pores(__global const int *groups, __global const int *triangle,
                            __global const float2 *logs, __global const float *stiffness, int count,
                            float width_exponent, float depth_exponent, float depth_limit,
                            __global float2 *scales)
{
    int first = first_in_group(groups);
    float r[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        int i = min(first + lane, count - 1);
        r[lane] = stiffened(mean_log_stretch(logs[triangle[i]]), stiffness, i);
    }
    store_scales(vload16(0, r), width_exponent, depth_exponent, depth_limit, first, count, scales);
}
